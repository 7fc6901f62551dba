; Room for results in arrays that are given.

; The numbers of an array of this shape that can be written to; null for any other object.
define internal ptr @room(ptr %object, i32 %dimensions, ptr %expected) nounwind alwaysinline {
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
  %wanted = and i32 %flags, 1281 ; NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED | NPY_ARRAY_WRITEABLE
  %is.plain = icmp eq i32 %wanted, 1281
  %ndim.at = getelementptr %array, ptr %object, i32 0, i32 3
  %ndim = load i32, ptr %ndim.at
  %is.deep = icmp eq i32 %ndim, %dimensions
  %is.both = and i1 %is.float64, %is.plain
  %is.all = and i1 %is.both, %is.deep
  br i1 %is.all, label %shaped, label %other

shaped:
  %shape.at = getelementptr %array, ptr %object, i32 0, i32 4
  %shape = load ptr, ptr %shape.at
  br label %dimension

dimension:
  %k = phi i32 [0, %shaped], [%next, %same]
  %done = icmp eq i32 %k, %dimensions
  br i1 %done, label %fitting, label %compared

compared:
  %has.at = getelementptr i64, ptr %shape, i32 %k
  %has = load i64, ptr %has.at
  %needs.at = getelementptr i64, ptr %expected, i32 %k
  %needs = load i64, ptr %needs.at
  %is.same = icmp eq i64 %has, %needs
  br i1 %is.same, label %same, label %other

same:
  %next = add i32 %k, 1
  br label %dimension

fitting:
  %data.at = getelementptr %array, ptr %object, i32 0, i32 2
  %data = load ptr, ptr %data.at
  ret ptr %data

other:
  ret ptr null
}

; Whether so many numbers after one pointer and so many after another share no memory.
define internal i1 @apart(ptr %one, i64 %length, ptr %other, i64 %count) nounwind alwaysinline {
  %one.end = getelementptr double, ptr %one, i64 %length
  %other.end = getelementptr double, ptr %other, i64 %count
  %before = icmp ule ptr %one.end, %other
  %after = icmp ule ptr %other.end, %one
  %apart = or i1 %before, %after
  ret i1 %apart
}
