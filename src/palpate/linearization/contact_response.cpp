#include "palpate/linearization/contact_response.h"

#include <cmath>
#include <cstddef>

namespace palpate {
namespace {

/// Collects the unknowns of one contact after the other.
class ResponseBuilder {
 public:
  explicit ResponseBuilder(std::size_t contacts) {
    const auto capacity = static_cast<Eigen::Index>(3 * contacts);
    out_.b.resize(3, capacity);
    out_.c.resize(3, capacity);
    out_.d.resize(capacity);
  }
  void add(std::size_t contact, const Vec3& b, const Vec3& c, double d = 0.0) {
    out_.contact.push_back(static_cast<int>(contact));
    out_.b.col(n_) = b;
    out_.c.col(n_) = c;
    out_.d[n_++] = d;
  }
  ContactResponse take() {
    out_.b.conservativeResize(Eigen::NoChange, n_);
    out_.c.conservativeResize(Eigen::NoChange, n_);
    out_.d.conservativeResize(n_);
    return std::move(out_);
  }

 private:
  ContactResponse out_;
  Eigen::Index n_ = 0;
};

// On the exact cone lambda_t = -mu lambda_n t with t = slip / speed; across t it turns with the slip,
//   dlambda_t = -(mu lambda_n / speed) (I - t t^T) dslip.
void addSliding(std::size_t contact, double mu, double normal_impulse, const Vec3& slip, ResponseBuilder& out) {
  const Vec3 normal = Vec3::UnitX();
  const double speed = slip.norm();
  if (mu == 0 || speed == 0 || normal_impulse <= 0) {
    out.add(contact, normal, normal);
    return;
  }
  const Vec3 along = slip / speed;
  const Vec3 across(0, -along.z(), along.y());
  out.add(contact, normal - mu * along, normal);
  out.add(contact, across, across, speed / (mu * normal_impulse));
}

}  // namespace

ContactResponse contactResponse(const ContactSet& set, const std::vector<int>& list, const std::vector<char>& used,
                                const FrictionCone& cone, const VecX& row_velocity) {
  ResponseBuilder out(list.size());
  const Vec3 normal = Vec3::UnitX();
  for (std::size_t at = 0; at < list.size(); ++at) {
    if (!used[at]) continue;
    const int i = list[at];
    const double mu = set.contacts[i].friction;
    const int index = set.status[i].index;
    switch (set.status[i].state) {
      case ContactState::open:
        break;
      case ContactState::stick:
        for (int k = 0; k < 3; ++k) out.add(at, Vec3::Unit(k), Vec3::Unit(k));
        break;
      case ContactState::vertex:
        out.add(at, normal + mu * vertexDirection(index, cone.facets), normal);
        break;
      case ContactState::edge: {
        const double apothem = mu * std::cos(M_PI / cone.facets);
        const Vec3 along = edgeTangent(index, cone.facets);
        out.add(at, normal + apothem * edgeNormal(index, cone.facets), normal);
        out.add(at, along, along);
        break;
      }
      case ContactState::slide: {
        const auto row = static_cast<Eigen::Index>(3 * at);
        addSliding(at, mu, set.impulse[3 * i], Vec3(0, row_velocity[row + 1], row_velocity[row + 2]), out);
        break;
      }
    }
  }
  return out.take();
}

}  // namespace palpate
