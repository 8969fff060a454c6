#include <algorithm>
#include <numeric>

#include "palpate/common/error.h"
#include "palpate/mesh/shapes.h"
#include "palpate/mesh/tetrahedral_formats.h"

namespace palpate {
namespace {

constexpr std::size_t kLargestMesh = 1'000'000;

const char* pluralOf(CellFamily family) {
  switch (family) {
    case CellFamily::flat:
      return "faces, lines or points";
    case CellFamily::tetrahedron:
      return "tetrahedra";
    case CellFamily::pyramid:
      return "pyramids";
    case CellFamily::prism:
      return "prisms";
    case CellFamily::hexahedron:
      return "hexahedra";
    case CellFamily::polyhedron:
      return "polyhedra";
    case CellFamily::unknown:
      break;
  }
  return "cells of unknown kinds";
}

}  // namespace

void CellCollector::node(long long number, const Vec3& x) {
  if (!index_.try_emplace(number, static_cast<int>(nodes_.size())).second)
    throw InputError(name_, "node " + std::to_string(number), "comes twice");
  nodes_.push_back(x);
}

void CellCollector::cell(CellFamily family, const std::vector<long long>& nodes) {
  if (family != CellFamily::tetrahedron) return leaveOut(family);
  if (nodes.size() < 4)
    throw InputError(name_, "tetrahedron " + std::to_string(tetrahedra_.size() + 1), "has fewer than four corners");
  if (tetrahedra_.size() >= kLargestMesh)
    throw InputError(name_, "", "has more than 1,000,000 tetrahedra, which is the limit");
  if (nodes.size() > 4) ++curved_;
  tetrahedra_.push_back({nodes[0], nodes[1], nodes[2], nodes[3]});
}

TetrahedralMesh CellCollector::finish(std::vector<std::string>* notes) {
  if (tetrahedra_.empty()) refuse();
  std::vector<std::string> said;
  TetrahedralMesh result;
  std::vector<int> renumbered(nodes_.size(), -1);
  for (const std::array<long long, 4>& numbers : withoutRepeated(said)) {
    std::array<int, 4> t{};
    for (std::size_t k = 0; k < 4; ++k) {
      const auto it = index_.find(numbers[k]);
      if (it == index_.end())
        throw InputError(name_, "tetrahedron " + std::to_string(result.tetrahedra.size() + 1),
                         "there is no node " + std::to_string(numbers[k]));
      int& n = renumbered[static_cast<std::size_t>(it->second)];
      if (n < 0) {
        n = static_cast<int>(result.nodes.size());
        result.nodes.push_back(nodes_[static_cast<std::size_t>(it->second)]);
      }
      t[k] = n;
    }
    result.tetrahedra.push_back(t);
  }
  if (curved_ > 0)
    said.push_back(name_ + ": of " + std::to_string(curved_) + " tetrahedra only the corners count, not nodes between");
  for (const std::string& what : leftOut()) said.push_back(name_ + ": its " + what + " are left out");
  if (notes != nullptr) notes->insert(notes->end(), said.begin(), said.end());
  // Checks volumes and turns inverted tetrahedra.
  return simulationMeshOf(std::move(result), name_).mesh;
}

// Some programs write a cell once for each group that it is in; twice the cell would be twice the stiffness.
std::vector<std::array<long long, 4>> CellCollector::withoutRepeated(std::vector<std::string>& notes) const {
  std::vector<std::array<long long, 4>> key = tetrahedra_;
  for (auto& k : key) std::sort(k.begin(), k.end());
  std::vector<std::size_t> order(key.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return key[a] != key[b] ? key[a] < key[b] : a < b; });
  std::vector<char> repeated(key.size(), 0);
  for (std::size_t i = 1; i < order.size(); ++i) repeated[order[i]] = key[order[i]] == key[order[i - 1]];
  std::vector<std::array<long long, 4>> out;
  for (std::size_t i = 0; i < key.size(); ++i) {
    if (!repeated[i]) out.push_back(tetrahedra_[i]);
  }
  if (out.size() < key.size())
    notes.push_back(name_ + ": " + std::to_string(key.size() - out.size()) + " repeated tetrahedra are left out");
  return out;
}

std::vector<std::string> CellCollector::leftOut() const {
  std::vector<std::string> out;
  for (const auto& [family, count] : left_out_) {
    if (family != CellFamily::flat) out.push_back(std::to_string(count) + " " + pluralOf(family));
  }
  return out;
}

void CellCollector::refuse() const {
  std::string others;
  for (const std::string& what : leftOut()) others += (others.empty() ? "" : ", ") + what;
  if (!others.empty())
    throw InputError(name_, "", "has no tetrahedra but " + others + ": only tetrahedra are simulated");
  const auto flat = left_out_.find(CellFamily::flat);
  if (flat != left_out_.end())
    throw InputError(name_, "",
                     "has no tetrahedra but " + std::to_string(flat->second) +
                         " faces, lines or points: a surface is given as a surface file, and gets its tetrahedra here");
  throw InputError(name_, "", "has no tetrahedra" + std::string(nodes_.empty() ? " and no nodes" : ""));
}

}  // namespace palpate
