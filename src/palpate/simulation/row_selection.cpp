#include "palpate/simulation/row_selection.h"

namespace palpate {

void ContactRows::gather(const VecX& all, VecX& own) const {
  own.resize(rows());
  for (std::size_t k = 0; k < contacts.size(); ++k) {
    own.segment<3>(static_cast<Eigen::Index>(3 * k)) = all.segment<3>(3 * contacts[k]);
  }
}

VecX ContactRows::gather(const VecX& all) const {
  VecX own;
  gather(all, own);
  return own;
}

void ContactRows::scatter(const VecX& own, VecX& all) const {
  for (std::size_t k = 0; k < contacts.size(); ++k) {
    all.segment<3>(3 * contacts[k]) = own.segment<3>(static_cast<Eigen::Index>(3 * k));
  }
}

MatX ContactRows::spread(const ContactRows& some, const Eigen::Ref<const MatX>& of_some) const {
  if (some.contacts.size() == contacts.size()) return of_some;
  MatX out = MatX::Zero(rows(), of_some.cols());
  std::size_t at = 0;
  for (std::size_t k = 0; k < some.contacts.size(); ++k, ++at) {
    while (contacts[at] != some.contacts[k]) ++at;
    out.middleRows<3>(static_cast<Eigen::Index>(3 * at)) = of_some.middleRows<3>(static_cast<Eigen::Index>(3 * k));
  }
  return out;
}

}  // namespace palpate
