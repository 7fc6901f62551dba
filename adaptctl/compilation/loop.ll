; All steps of one block of lanes after the other.
;
; A block goes through all its steps before the next begins, so that its state stays in the nearest memory: there and
; in a spare place by turns, since a step reads one while it writes the other. What is the same in all of them is
; computed before the first.

define void @run(i64 %first, i64 %end, i64 %count, i64 %shared.stride, i64 %driven.stride, i64 %out.stride,
                 ptr %state, ptr %held, ptr %shared, ptr %driven, ptr %out) $attributes {
start:
  %spare = alloca [$state x $value], align $alignment
  %same = alloca [$same x $value], align $alignment
  br label %blocks

blocks:
  %block = phi i64 [%first, %start], [%block.next, %stepped]
  %block.left = icmp slt i64 %block, %end
  br i1 %block.left, label %begin, label %finished

begin:
  %own = getelementptr [$state x $value], ptr %state, i64 %block
  %held.at = getelementptr [$held x $value], ptr %held, i64 %block
  %driven.first = getelementptr [$driven x $value], ptr %driven, i64 %block
  %out.first = getelementptr [$outputs x $value], ptr %out, i64 %block
  $held_places
  $before
  br label %steps

steps:
  %step = phi i64 [0, %begin], [%step.next, %work]
  %state.at = phi ptr [%own, %begin], [%next, %work]
  %next = phi ptr [%spare, %begin], [%state.at, %work]
  %step.left = icmp slt i64 %step, %count
  br i1 %step.left, label %work, label %stepped

work:
  %shared.skip = mul i64 %step, %shared.stride
  %driven.skip = mul i64 %step, %driven.stride
  %out.skip = mul i64 %step, %out.stride
  %shared.at = getelementptr $scalar, ptr %shared, i64 %shared.skip
  %driven.at = getelementptr $scalar, ptr %driven.first, i64 %driven.skip
  %out.at = getelementptr $scalar, ptr %out.first, i64 %out.skip
  $places
  call void @$routine($pointers)
  %step.next = add i64 %step, 1
  br label %steps

stepped:
  call void @llvm.memmove.p0.p0.i64(ptr %own, ptr %state.at, i64 $bytes, i1 false)
  %block.next = add i64 %block, 1
  br label %blocks

finished:
  ret void
}
