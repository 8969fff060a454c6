#include "palpate/live/tick_algebra.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(TickAlgebra, GramIsTheProductForAnyNumberOfContacts) {
  for (int contacts = 1; contacts <= LiveSize::kContacts; ++contacts) {
    for (const int columns : {0, 1, 6, LiveSize::kUnknowns}) {
      const TickRows x = MatX::Random(3 * contacts, columns);
      const MatX root = MatX::Random(3 * contacts, 3 * contacts);
      const TickCompliance before = root + root.transpose();
      TickCompliance g = before;
      addGram(0.7, x, g);
      const MatX wanted = MatX(before) + 0.7 * MatX(x) * MatX(x).transpose();
      EXPECT_LT((MatX(g) - wanted).cwiseAbs().maxCoeff(), 1e-13) << contacts << " contacts, " << columns << " columns";
      EXPECT_EQ(MatX(g), MatX(g).transpose());
    }
  }
}

}  // namespace
}  // namespace palpate
