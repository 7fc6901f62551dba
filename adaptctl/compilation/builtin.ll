; One of Python's own functions (METH_FASTCALL): the routine, called with arrays.

%array = type {i64, ptr, ptr, i32, ptr, ptr, ptr, ptr, i32}
; references, type, data, ndim, shape, strides, base, dtype, flags (numpy/ndarraytypes.h)

@numpy.ndarray = external global i8
@numpy.float64 = external global i8
declare ptr @numpy.new(ptr, i32, ptr, i32, ptr, ptr, i32, i32, ptr)
declare ptr @PyObject_Vectorcall(ptr, ptr, i64, ptr)
declare ptr @PyTuple_New(i64)
declare i32 @PyTuple_SetItem(ptr, i64, ptr)
declare ptr @PyFloat_FromDouble(double)
declare void @Py_DecRef(ptr)

$shapes

define ptr @call(ptr %instead, ptr %arguments, i64 %count) nounwind {
  $numbers
  %counted = icmp eq i64 %count, $expected
  br i1 %counted, label %look, label %unusual

look:
  $look

unusual:
  %other = call ptr @PyObject_Vectorcall(ptr %instead, ptr %arguments, i64 %count, ptr null)
  ret ptr %other

usual:
  $allocate

failed:
  $released
  ret ptr null

compute:
  $data
  call void @$routine($pointers)
  $check

infinite:
  $released
  br label %unusual

finite:
  $packed
}

; The numbers of a usual array of this length; null for any other object.
define internal ptr @usual(ptr %object, i64 %length) nounwind alwaysinline {
  %type.at = getelementptr %array, ptr %object, i32 0, i32 1
  %type = load ptr, ptr %type.at
  %is.array = icmp eq ptr %type, @numpy.ndarray
  br i1 %is.array, label %array, label %other

array:
  %dtype.at = getelementptr %array, ptr %object, i32 0, i32 7
  %dtype = load ptr, ptr %dtype.at
  %is.float64 = icmp eq ptr %dtype, @numpy.float64
  %flags.at = getelementptr %array, ptr %object, i32 0, i32 8
  %flags = load i32, ptr %flags.at
  %contiguous.aligned = and i32 %flags, 257 ; NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED
  %is.plain = icmp eq i32 %contiguous.aligned, 257
  %ndim.at = getelementptr %array, ptr %object, i32 0, i32 3
  %ndim = load i32, ptr %ndim.at
  %is.vector = icmp eq i32 %ndim, 1
  %is.both = and i1 %is.float64, %is.plain
  %is.all = and i1 %is.both, %is.vector
  br i1 %is.all, label %vector, label %other

vector:
  %shape.at = getelementptr %array, ptr %object, i32 0, i32 4
  %shape = load ptr, ptr %shape.at
  %size = load i64, ptr %shape
  %is.long = icmp eq i64 %size, %length
  br i1 %is.long, label %fitting, label %other

fitting:
  %data.at = getelementptr %array, ptr %object, i32 0, i32 2
  %data = load ptr, ptr %data.at
  ret ptr %data

other:
  ret ptr null
}

; Whether so many numbers are all finite: then zero times each is zero, else NaN; in eights first, and then the rest.
define internal i1 @finite(ptr %data, i64 %count) nounwind noinline {
start:
  br label %eights

eights:
  %k = phi i64 [0, %start], [%k.next, %eight]
  %all = phi <8 x i64> [zeroinitializer, %start], [%all.next, %eight]
  %k.next = add i64 %k, 8
  %fits = icmp sle i64 %k.next, %count
  br i1 %fits, label %eight, label %ones

eight:
  %x.at = getelementptr double, ptr %data, i64 %k
  %x = load <8 x double>, ptr %x.at, align 8
  %nothing = fmul <8 x double> %x, zeroinitializer
  %bits = bitcast <8 x double> %nothing to <8 x i64>
  %all.next = or <8 x i64> %all, %bits ; a NaN stays one whatever bits are added
  br label %eights

ones:
  %j = phi i64 [%k, %eights], [%j.next, %one]
  %rest = phi i64 [0, %eights], [%rest.next, %one]
  %left = icmp slt i64 %j, %count
  br i1 %left, label %one, label %end

one:
  %y.at = getelementptr double, ptr %data, i64 %j
  %y = load double, ptr %y.at
  %y.nothing = fmul double %y, 0.0
  %y.bits = bitcast double %y.nothing to i64
  %rest.next = or i64 %rest, %y.bits
  %j.next = add i64 %j, 1
  br label %ones

end:
  %eight.numbers = bitcast <8 x i64> %all to <8 x double>
  %eight.finite = fcmp ord <8 x double> %eight.numbers, zeroinitializer
  %all.finite = call i1 @llvm.vector.reduce.and.v8i1(<8 x i1> %eight.finite)
  %rest.number = bitcast i64 %rest to double
  %rest.finite = fcmp ord double %rest.number, 0.0
  %every = and i1 %all.finite, %rest.finite
  ret i1 %every
}
