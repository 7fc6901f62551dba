; Sines and cosines of the angles in all lanes, up to the farthest that `sine.py` reduces.
define internal {$value, $value} @sines.near$tag($value %x) alwaysinline $attributes {
  %angle = alloca $value
  %sine.at = alloca $value
  %cosine.at = alloca $value
  %shifted.at = alloca $value
  store $value %x, ptr %angle
  call void @sines.reduced$tag(ptr %angle, ptr %sine.at, ptr %cosine.at, ptr %shifted.at)
  %sine = load $value, ptr %sine.at
  %cosine = load $value, ptr %cosine.at

  ; After k quarter turns: of an odd number they change places, and of the second bit of k and of k + 1 are their signs.
  %k = load $integer, ptr %shifted.at
  %next = add $integer %k, $one
  %parity = shl $integer %k, $last
  %odd = icmp slt $integer %parity, $zero
  %first = select $condition %odd, $value %cosine, $value %sine
  %second = select $condition %odd, $value %sine, $value %cosine
  %first.bits = bitcast $value %first to $integer
  %second.bits = bitcast $value %second to $integer
  %k.high = shl $integer %k, $second
  %next.high = shl $integer %next, $second
  %first.sign = and $integer %k.high, $sign
  %second.sign = and $integer %next.high, $sign
  %sin.bits = xor $integer %first.bits, %first.sign
  %cos.bits = xor $integer %second.bits, %second.sign
  %sin = bitcast $integer %sin.bits to $value
  %cos = bitcast $integer %cos.bits to $value
  %one = insertvalue {$value, $value} undef, $value %sin, 0
  %both = insertvalue {$value, $value} %one, $value %cos, 1
  ret {$value, $value} %both
}

; Those of angles a step, up to the longest, from angles of known ones.
define internal {$value, $value} @sines.turned$tag($value %step, $value %known.sin, $value %known.cos) alwaysinline $attributes {
  %given = alloca [3 x $value]
  %sine.at = alloca $value
  %cosine.at = alloca $value
  %second = getelementptr $value, ptr %given, i64 1
  %third = getelementptr $value, ptr %given, i64 2
  store $value %known.sin, ptr %given
  store $value %known.cos, ptr %second
  store $value %step, ptr %third
  call void @sines.step$tag(ptr %given, ptr %sine.at, ptr %cosine.at)
  %sin = load $value, ptr %sine.at
  %cos = load $value, ptr %cosine.at
  %one = insertvalue {$value, $value} undef, $value %sin, 0
  %both = insertvalue {$value, $value} %one, $value %cos, 1
  ret {$value, $value} %both
}

; The lanes whose numbers are beyond a limit, or not finite.
define internal $condition @sines.beyond$tag($value %x, $value %limit) alwaysinline $attributes {
  %size = call $value @llvm.fabs.$suffix($value %x)
  %beyond = fcmp ugt $value %size, %limit
  ret $condition %beyond
}
