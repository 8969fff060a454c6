#include "palpate/contact/pair_search.h"

namespace palpate {

// Each axis gives two conditions, linear in time; boxes are apart where one fails throughout, or where they do not hold
// at any one time together.
bool PairSearch::meetInTime(const MovingBox& p, const MovingBox& q) const {
  using Corner = MovingBox::Corner;
  Corner low0 = p.start_low + q.start_negative_high, high0 = p.start_negative_high + q.start_low;
  Corner low1 = p.end_low + q.end_negative_high, high1 = p.end_negative_high + q.end_low;
  if (from > 0 || to < 1) {
    const float f = static_cast<float>(from), t = static_cast<float>(to);
    const Corner low = low1 - low0, high = high1 - high0;
    low1 = low0 + t * low;
    high1 = high0 + t * high;
    low0 += f * low;
    high0 += f * high;
    if (low0.min(low1).max(high0.min(high1)).maxCoeff() > box_reach) return false;
  }
  float enter = 0, leave = 1;
  const auto restrict = [&](const Corner& begin, const Corner& finish) {
    for (int i = 0; i < 3; ++i) {
      const float f0 = begin[i] - box_reach, f1 = finish[i] - box_reach;
      if (f0 > 0)
        enter = std::max(enter, f0 / (f0 - f1));
      else if (f1 > 0)
        leave = std::min(leave, f0 / (f0 - f1));
    }
  };
  restrict(low0, low1);
  restrict(high0, high1);
  return enter <= leave + 1e-4f;
}

}  // namespace palpate
