; Sines and cosines of the angles in all lanes.

define internal {$value, $value} @sincos($value %x) alwaysinline $attributes {
  %angle = alloca $value
  %sine = alloca $value
  %cosine = alloca $value
  store $value %x, ptr %angle
  call void @sincos.near(ptr %angle, ptr %sine, ptr %cosine)
  %sin = load $value, ptr %sine
  %cos = load $value, ptr %cosine
  %size = call $value @llvm.fabs.$suffix($value %x)
  %far = fcmp ugt $value %size, $farthest
  %bits = bitcast $condition %far to i$count
  %any = icmp ne i$count %bits, 0
  br i1 %any, label %corrected, label %returned

corrected:
  %exact = call {$value, $value} @sincos.far($value %x, $value %sin, $value %cos, $condition %far)
  ret {$value, $value} %exact

returned:
  %first = insertvalue {$value, $value} undef, $value %sin, 0
  %both = insertvalue {$value, $value} %first, $value %cos, 1
  ret {$value, $value} %both
}

; Where an angle is far, or not finite, the C library's instead.
define internal {$value, $value} @sincos.far($value %x, $value %sin, $value %cos, $condition %far) noinline cold $attributes {
  %library.sin = call $value @llvm.sin.$suffix($value %x)
  %library.cos = call $value @llvm.cos.$suffix($value %x)
  %s = select $condition %far, $value %library.sin, $value %sin
  %c = select $condition %far, $value %library.cos, $value %cos
  %first = insertvalue {$value, $value} undef, $value %s, 0
  %both = insertvalue {$value, $value} %first, $value %c, 1
  ret {$value, $value} %both
}
