; Rows of arrays to lanes and back, for any routine.

!0 = !{i32 1}

; The number of a sample for each lane is the first and so many more, at most the last.
define internal i64 @sample(i64 %first, i64 %lane, i64 %last) nounwind alwaysinline {
  %more = add i64 %first, %lane
  %sample = call i64 @llvm.smin.i64(i64 %more, i64 %last)
  ret i64 %sample
}
declare i64 @llvm.smin.i64(i64, i64)

; What all samples share (stride 0) is gathered with the first of them.
define void @gather(ptr noalias %to, ptr noalias %rows, i64 %stride, i64 %count, i64 %first, i64 %last) $attributes {
start:
  $rows
  %shared = icmp eq i64 %stride, 0
  %later = icmp ne i64 %first, 0
  %known = and i1 %shared, %later
  br i1 %known, label %end, label %columns

columns:
  %k = phi i64 [0, %start], [%next, %column]
  %next = add i64 %k, 1
  %left = icmp slt i64 %k, %count
  br i1 %left, label %column, label %end

column:
  $loads
  %to.at = getelementptr $value, ptr %to, i64 %k
  store $value $gathered, ptr %to.at, align 8
  br label %columns

end:
  ret void
}

; Squares of as many columns as lanes are turned in registers, so that each row is written in one piece; what columns are
; left, number by number. Streamed pieces go past the caches, which would first read what they replace.
define void @scatter(ptr noalias %rows, ptr noalias %from, i64 %stride, i64 %count, i64 %first, i64 %last, i1 %streamed) $attributes {
start:
  $rows
  %whole = and i64 %count, -$count
  br label %squares

squares:
  %square.k = phi i64 [0, %start], [%square.next, %stream], [%square.next, %keep]
  %square.next = add i64 %square.k, $count
  %square.left = icmp slt i64 %square.k, %whole
  br i1 %square.left, label %square, label %columns

square:
  $turned
  br i1 %streamed, label %stream, label %keep

stream:
  $streamed
  br label %squares

keep:
  $kept
  br label %squares

columns:
  %k = phi i64 [%whole, %squares], [%next, %column]
  %next = add i64 %k, 1
  %left = icmp slt i64 %k, %count
  br i1 %left, label %column, label %end

column:
  %from.at = getelementptr $value, ptr %from, i64 %k
  %all = load $value, ptr %from.at, align 8
  $stores
  br label %columns

end:
  ret void
}
