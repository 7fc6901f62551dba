; Whether so many numbers are all finite: then zero times each is zero, else NaN; in eights first, and then the rest.
define internal i1 @finite(ptr %data, i64 %count) nounwind noinline {
start:
  br label %eights

eights:
  %k = phi i64 [0, %start], [%k.next, %eight]
  %all = phi <8 x i64> [zeroinitializer, %start], [%all.next, %eight]
  %k.next = add i64 %k, 8
  %fits = icmp sle i64 %k.next, %count
  br i1 %fits, label %eight, label %ones

eight:
  %x.at = getelementptr double, ptr %data, i64 %k
  %x = load <8 x double>, ptr %x.at, align 8
  %nothing = fmul <8 x double> %x, zeroinitializer
  %bits = bitcast <8 x double> %nothing to <8 x i64>
  %all.next = or <8 x i64> %all, %bits ; a NaN stays one whatever bits are added
  br label %eights

ones:
  %j = phi i64 [%k, %eights], [%j.next, %one]
  %rest = phi i64 [0, %eights], [%rest.next, %one]
  %left = icmp slt i64 %j, %count
  br i1 %left, label %one, label %end

one:
  %y.at = getelementptr double, ptr %data, i64 %j
  %y = load double, ptr %y.at
  %y.nothing = fmul double %y, 0.0
  %y.bits = bitcast double %y.nothing to i64
  %rest.next = or i64 %rest, %y.bits
  %j.next = add i64 %j, 1
  br label %ones

end:
  %eight.numbers = bitcast <8 x i64> %all to <8 x double>
  %eight.finite = fcmp ord <8 x double> %eight.numbers, zeroinitializer
  %all.finite = call i1 @llvm.vector.reduce.and.v8i1(<8 x i1> %eight.finite)
  %rest.number = bitcast i64 %rest to double
  %rest.finite = fcmp ord double %rest.number, 0.0
  %every = and i1 %all.finite, %rest.finite
  ret i1 %every
}
