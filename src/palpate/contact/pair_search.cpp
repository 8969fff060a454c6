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
  // not both ends are above reach: the share of the way that is, for the start and for the end; 0 for none, and for the
  // fourth coordinate
  Corner before = Corner::Zero(), after = Corner::Zero();
  const auto restrict = [&](const Corner& begin, const Corner& finish) {
    const Corner above0 = (begin - box_reach).max(0.0f), below0 = (box_reach - begin).max(0.0f);
    const Corner above1 = (finish - box_reach).max(0.0f), below1 = (box_reach - finish).max(0.0f);
    constexpr float kTiny = std::numeric_limits<float>::min();
    before = before.max(above0 / (above0 + below1 + kTiny));
    after = after.max(above1 / (above1 + below0 + kTiny));
  };
  restrict(low0, low1);
  restrict(high0, high1);
  return before.maxCoeff() + after.maxCoeff() <= 1 + 1e-4f;
}

}  // namespace palpate
