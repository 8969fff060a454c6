#include "palpate/simulation/contact_memory.h"

#include <algorithm>

namespace palpate {

void ContactMemory::touchedNodes(int body, int nodes, std::vector<int>& out) const {
  for (auto at = std::lower_bound(touched.begin(), touched.end(), std::pair(body, 0));
       at != touched.end() && at->first == body && at->second < nodes; ++at) {
    out.push_back(at->second);
  }
}

const ContactMemory::Force* ContactMemory::find(std::uint64_t track) const {
  const auto at = std::lower_bound(forces.begin(), forces.end(), track,
                                   [](const Force& a, std::uint64_t t) { return a.track < t; });
  return at != forces.end() && at->track == track ? &*at : nullptr;
}

Vec3 ContactMemory::loadedForce(std::size_t k) const {
  return loaded[k].frame().transpose() * loaded_force.segment<3>(static_cast<Eigen::Index>(3 * k));
}

void ContactMemory::tracks(std::vector<std::uint64_t>& out) const {
  out.clear();
  for (const Force& f : forces) out.push_back(f.track);
}

}  // namespace palpate
