#pragma once

namespace palpate {

/// One function object of several, for std::visit: the case that fits the value's type is called.
template <typename... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};
template <typename... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;

}  // namespace palpate
