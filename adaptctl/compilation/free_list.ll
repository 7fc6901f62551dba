; Arrays for results, used again once nobody else holds them: making one takes as long as a hundred operations.

; The last two arrays that were returned for a result are among the objects that the function keeps, from %first on. One
; to which there is no other reference is returned again, or else a new one, which takes the place of the older.
define internal ptr @made(ptr %kept, i64 %first, i32 %dimensions, ptr %shape) nounwind {
  %older.at = getelementptr %tuple, ptr %kept, i32 0, i32 3, i64 %first
  %older = load ptr, ptr %older.at
  %older.spare = call i1 @spare(ptr %older, i32 %dimensions, ptr %shape)
  br i1 %older.spare, label %again, label %younger

younger:
  %second = add i64 %first, 1
  %latest.at = getelementptr %tuple, ptr %kept, i32 0, i32 3, i64 %second
  %latest = load ptr, ptr %latest.at
  %latest.spare = call i1 @spare(ptr %latest, i32 %dimensions, ptr %shape)
  br i1 %latest.spare, label %again, label %anew

again:
  %free = phi ptr [%older, %0], [%latest, %younger]
  call void @Py_IncRef(ptr %free)
  ret ptr %free

anew:
  %new = call ptr @numpy.new(ptr @numpy.ndarray, i32 %dimensions, ptr %shape, i32 12, ; NPY_DOUBLE
    ptr null, ptr null, i32 0, i32 0, ptr null)
  %is.made = icmp ne ptr %new, null
  br i1 %is.made, label %keep, label %end

keep:
  call void @Py_IncRef(ptr %new)
  store ptr %latest, ptr %older.at
  store ptr %new, ptr %latest.at
  call void @Py_DecRef(ptr %older)
  br label %end

end:
  ret ptr %new
}

; Whether nothing but the function refers to an object, not even weakly, and it is an array as it was returned.
define internal i1 @spare(ptr %object, i32 %dimensions, ptr %shape) nounwind alwaysinline {
  %references = load i32, ptr %object ; the count is in the lower half, whatever Python keeps in the upper
  %is.alone = icmp eq i32 %references, 1
  br i1 %is.alone, label %alone, label %held

alone:
  %room = call ptr @room(ptr %object, i32 %dimensions, ptr %shape)
  %is.array = icmp ne ptr %room, null
  br i1 %is.array, label %array, label %held

array:
  %flags.at = getelementptr %array, ptr %object, i32 0, i32 8
  %flags = load i32, ptr %flags.at
  %owned = and i32 %flags, 4 ; NPY_ARRAY_OWNDATA
  %is.owner = icmp ne i32 %owned, 0
  %weak.at = getelementptr %array, ptr %object, i32 0, i32 9
  %weak = load ptr, ptr %weak.at
  %is.unwatched = icmp eq ptr %weak, null
  %is.spare = and i1 %is.owner, %is.unwatched
  ret i1 %is.spare

held:
  ret i1 false
}

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
