#pragma once

#include <utility>

#include "palpate/contact/contact.h"

namespace palpate {

/// A contact's rows are those of the relative velocity  v_first - v_second = sum_k s_k v(node_k),  over the nodes of
/// both of its points, with s_k the node's weight in the first point and minus its weight in the second one.

/// Calls f(node, s) for the nodes that belong to `body`: those of the first point, then those of the second. Where both
/// points are of that body a node may come twice.
template <class F>
void forEachNode(const Contact& contact, int body, F&& f) {
  if (contact.first.body == body) {
    for (int k = 0; k < contact.first.count; ++k) f(contact.first.node[k], contact.first.weight[k]);
  }
  if (contact.second.body == body) {
    for (int k = 0; k < contact.second.count; ++k) f(contact.second.node[k], -contact.second.weight[k]);
  }
}

}  // namespace palpate
