; One of Python's own functions (METH_FASTCALL): the routine, called with arrays.

%array = type {i64, ptr, ptr, i32, ptr, ptr, ptr, ptr, i32, ptr}
; references, type, data, ndim, shape, strides, base, dtype, flags, weak references (numpy/ndarraytypes.h)
%tuple = type {i64, ptr, i64, [0 x ptr]}
; references, type, size, items (cpython/Include/cpython/tupleobject.h)

@numpy.ndarray = external global i8
@numpy.float64 = external global i8
declare ptr @numpy.new(ptr, i32, ptr, i32, ptr, ptr, i32, i32, ptr)
declare ptr @PyObject_Vectorcall(ptr, ptr, i64, ptr)
declare ptr @PyTuple_New(i64)
declare ptr @PyType_GenericAlloc(ptr, i64)
declare ptr @PyFloat_FromDouble(double)
declare void @Py_IncRef(ptr)
declare void @Py_DecRef(ptr)

$shapes

define ptr @call(ptr %kept, ptr %arguments, i64 %count) nounwind {
  $numbers
  %counted = icmp eq i64 %count, $expected
  br i1 %counted, label %look, label %unusual

look:
  $look

unusual:
  %instead.at = getelementptr %tuple, ptr %kept, i32 0, i32 3, i64 0
  %instead = load ptr, ptr %instead.at
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

; Whether an object is a tuple of this type and size.
define internal i1 @is(ptr %object, ptr %expected, i64 %count) nounwind alwaysinline {
  %type.at = getelementptr %tuple, ptr %object, i32 0, i32 1
  %type = load ptr, ptr %type.at
  %is.tuple = icmp eq ptr %type, %expected
  br i1 %is.tuple, label %tuple, label %other

tuple:
  %size.at = getelementptr %tuple, ptr %object, i32 0, i32 2
  %size = load i64, ptr %size.at
  %is.long = icmp eq i64 %size, %count
  ret i1 %is.long

other:
  ret i1 false
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
