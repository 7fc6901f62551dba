; Sines and cosines of the angles in all lanes.

define internal {$value, $value} @sincos$tag($value %x) alwaysinline $attributes {
  %angle = alloca $value
  %sine.at = alloca $value
  %cosine.at = alloca $value
  %shifted.at = alloca $value
  store $value %x, ptr %angle
  call void @sincos.near$tag(ptr %angle, ptr %sine.at, ptr %cosine.at, ptr %shifted.at)
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

  %size = call $value @llvm.fabs.$suffix($value %x)
  %far = fcmp ugt $value %size, $farthest
  %bits = bitcast $condition %far to i$count
  %any = icmp ne i$count %bits, 0
  br i1 %any, label %corrected, label %returned

corrected:
  %exact = call {$value, $value} @sincos.far$tag($value %x, $value %sin, $value %cos, $condition %far)
  ret {$value, $value} %exact

returned:
  %one = insertvalue {$value, $value} undef, $value %sin, 0
  %both = insertvalue {$value, $value} %one, $value %cos, 1
  ret {$value, $value} %both
}

; Where an angle is far, or not finite, the C library's instead.
define internal {$value, $value} @sincos.far$tag($value %x, $value %sin, $value %cos, $condition %far) noinline cold $attributes {
  %library.sin = call $value @llvm.sin.$suffix($value %x)
  %library.cos = call $value @llvm.cos.$suffix($value %x)
  %s = select $condition %far, $value %library.sin, $value %sin
  %c = select $condition %far, $value %library.cos, $value %cos
  %first = insertvalue {$value, $value} undef, $value %s, 0
  %both = insertvalue {$value, $value} %first, $value %c, 1
  ret {$value, $value} %both
}

; Sines and cosines of angles x, a step from where they are known.
define internal {$value, $value} @sincos.turned$tag($value %x, $value %step, {$value, $value} %known) alwaysinline $attributes {
  %given = alloca [3 x $value]
  %sine.at = alloca $value
  %cosine.at = alloca $value
  %known.sin = extractvalue {$value, $value} %known, 0
  %known.cos = extractvalue {$value, $value} %known, 1
  %second = getelementptr $value, ptr %given, i64 1
  %third = getelementptr $value, ptr %given, i64 2
  store $value %known.sin, ptr %given
  store $value %known.cos, ptr %second
  store $value %step, ptr %third
  call void @sincos.step$tag(ptr %given, ptr %sine.at, ptr %cosine.at)
  %sin = load $value, ptr %sine.at
  %cos = load $value, ptr %cosine.at
  %one = insertvalue {$value, $value} undef, $value %sin, 0
  %both = insertvalue {$value, $value} %one, $value %cos, 1

  %size = call $value @llvm.fabs.$suffix($value %step)
  %far = fcmp ugt $value %size, $longest
  %bits = bitcast $condition %far to i$count
  %any = icmp ne i$count %bits, 0
  br i1 %any, label %anew, label %returned

anew:
  %exact = call {$value, $value} @sincos.anew$tag($value %x, {$value, $value} %both, $condition %far)
  ret {$value, $value} %exact

returned:
  ret {$value, $value} %both
}

; Where the step is long, or not finite, those of the angle itself.
define internal {$value, $value} @sincos.anew$tag($value %x, {$value, $value} %turned, $condition %far) noinline cold $attributes {
  %whole = call {$value, $value} @sincos$tag($value %x)
  %whole.sin = extractvalue {$value, $value} %whole, 0
  %whole.cos = extractvalue {$value, $value} %whole, 1
  %turned.sin = extractvalue {$value, $value} %turned, 0
  %turned.cos = extractvalue {$value, $value} %turned, 1
  %sin = select $condition %far, $value %whole.sin, $value %turned.sin
  %cos = select $condition %far, $value %whole.cos, $value %turned.cos
  %first = insertvalue {$value, $value} undef, $value %sin, 0
  %both = insertvalue {$value, $value} %first, $value %cos, 1
  ret {$value, $value} %both
}
