; A routine at many samples, so many at once: rows of arrays are gathered into lanes, and the results put into rows.
; Returns whether all that was to be checked is finite. In the last lanes the last sample is repeated.

define i1 @batch(i64 %samples, ptr %inputs, ptr %strides, ptr %outputs) $attributes {
start:
  $memory
  %last = sub i64 %samples, 1
  br label %blocks

blocks:
  %first = phi i64 [0, %start], [%following, %work]
  %sound = phi i1 [true, %start], [%still.sound, %work]
  %following = add i64 %first, $count
  %left = icmp slt i64 %first, %samples
  br i1 %left, label %work, label %finished

work:
  $gather
  call void @$routine($pointers)
  $scatter
  $check
  br label %blocks

finished:
  fence seq_cst ; what was streamed is there for other threads too
  ret i1 %sound
}

; Whether results of so many numbers a row are streamed: rows are whole cache lines, and all of them more than caches keep.
define internal i1 @streams(ptr %rows, i64 %count, i64 %samples) nounwind alwaysinline {
  %at = ptrtoint ptr %rows to i64
  %length = mul i64 %count, 8
  %ends = or i64 %at, %length
  %beyond = and i64 %ends, $beyond
  %lines = icmp eq i64 %beyond, 0
  %numbers = mul i64 %count, %samples
  %many = icmp sge i64 %numbers, $many
  %streams = and i1 %lines, %many
  ret i1 %streams
}
