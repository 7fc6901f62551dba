; Of so many angles side by side, the pairs of sine and cosine: where an angle is far, or not finite, the C library's.
define internal void @sines.far(ptr %angles, ptr %pairs, i64 %n) noinline cold $attributes {
start:
  br label %angle

angle:
  %k = phi i64 [0, %start], [%next, %angle]
  %twice = shl i64 %k, 1
  %x.at = getelementptr $value, ptr %angles, i64 %k
  %sin.at = getelementptr $value, ptr %pairs, i64 %twice
  %cos.at = getelementptr $value, ptr %sin.at, i64 1
  %x = load $value, ptr %x.at
  %sin = load $value, ptr %sin.at
  %cos = load $value, ptr %cos.at
  %far = call $condition @sines.beyond$tag($value %x, $value $farthest)
  %library.sin = call $value @llvm.sin.$suffix($value %x)
  %library.cos = call $value @llvm.cos.$suffix($value %x)
  %s = select $condition %far, $value %library.sin, $value %sin
  %c = select $condition %far, $value %library.cos, $value %cos
  store $value %s, ptr %sin.at
  store $value %c, ptr %cos.at
  %next = add i64 %k, 1
  %left = icmp ult i64 %next, %n
  br i1 %left, label %angle, label %done

done:
  ret void
}

; Where the step to an angle is long, or not finite, those of the angle itself.
define internal void @sines.anew(ptr %angles, ptr %steps, ptr %pairs, i64 %n) noinline cold $attributes {
start:
  %own = alloca [2 x $value], align $alignment
  %own.cos.at = getelementptr $value, ptr %own, i64 1
  br label %angle

angle:
  %k = phi i64 [0, %start], [%next, %angle]
  %twice = shl i64 %k, 1
  %x.at = getelementptr $value, ptr %angles, i64 %k
  %step.at = getelementptr $value, ptr %steps, i64 %k
  %sin.at = getelementptr $value, ptr %pairs, i64 %twice
  %cos.at = getelementptr $value, ptr %sin.at, i64 1
  %x = load $value, ptr %x.at
  %near = call {$value, $value} @sines.near$tag($value %x)
  %near.sin = extractvalue {$value, $value} %near, 0
  %near.cos = extractvalue {$value, $value} %near, 1
  store $value %near.sin, ptr %own
  store $value %near.cos, ptr %own.cos.at
  call void @sines.far(ptr %x.at, ptr %own, i64 1)
  %own.sin = load $value, ptr %own
  %own.cos = load $value, ptr %own.cos.at
  %step = load $value, ptr %step.at
  %far = call $condition @sines.beyond$tag($value %step, $value $longest)
  %sin = load $value, ptr %sin.at
  %cos = load $value, ptr %cos.at
  %s = select $condition %far, $value %own.sin, $value %sin
  %c = select $condition %far, $value %own.cos, $value %cos
  store $value %s, ptr %sin.at
  store $value %c, ptr %cos.at
  %next = add i64 %k, 1
  %left = icmp ult i64 %next, %n
  br i1 %left, label %angle, label %done

done:
  ret void
}
