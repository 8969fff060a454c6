#pragma once

#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// Some of the contacts of a step, and where their rows are: three a contact (normal, first and second tangent), in the
/// order of `contacts`.
struct ContactRows {
  std::vector<int> contacts;  ///< increasing, as places in the list of all

  Eigen::Index rows() const { return static_cast<Eigen::Index>(3 * contacts.size()); }
  /// Own rows out of those of all contacts.
  void gather(const VecX& all, VecX& own) const;
  VecX gather(const VecX& all) const;
  /// Writes own rows to their place among those of all contacts.
  void scatter(const VecX& own, VecX& all) const;
  /// Rows of some of these contacts at their place among the own rows, zero elsewhere: [rows() x columns].
  MatX spread(const ContactRows& some, const Eigen::Ref<const MatX>& of_some) const;
};

/// One body's part in the contact rows.
struct BodyContactRows : ContactRows {
  std::size_t known = 0;  ///< how many of the contacts have their rows already
  MatX handle;            ///< J_h^T: 6 x rows, of a body with a handle frame
  MatX z;                 ///< (J_h - J_t X)^T: 6 x rows, of a body with a handle frame
  MatX delassus;          ///< J A^-1 J^T of this body alone [1/kg]: rows x rows, lower triangle
};

}  // namespace palpate
