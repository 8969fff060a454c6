#pragma once

#include <vector>

#include "palpate/linearization/contact_response.h"
#include "palpate/linearization/linearize.h"

namespace palpate {

using Mat6X = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// The paper's step 2: the contacts that the linearization keeps, as equalities.
struct ActiveContacts {
  const BodyContactRows* own = nullptr;  ///< of the tool; null: nothing touches it
  ContactRows list;                      ///< contacts that answer to the handle's motion
  const MatX* delassus = nullptr;        ///< W of the list's rows; of `hsl` the lower triangle
  Mat6X handle;                          ///< J_h^T: 6 x rows of the list
  Mat6X z;                               ///< (J_h - J_t X)^T: 6 x rows of the list
  ContactResponse law;                   ///< of those that are used
  DelassusModel model = DelassusModel::diagonal;

  bool any() const { return own != nullptr; }
  /// dlambda for given changes of the rows' free velocity and of the constraint's right-hand side: [rows x 12]. Eq. (9)
  /// differentiated, with A_lambda's diagonal or all of it.
  MatX impulseResponse(const MatX& free_change, const MatX& given) const;
};
ActiveContacts activeContacts(const World& world, const LinearizationSettings& settings);

}  // namespace palpate
