// Loops of kernels written out at compile time, so that every accumulator of an array gets a register.
#pragma once

#include <cstddef>
#include <utility>

namespace rilievo::matching {

/// Calls body.operator()<0>() ... body.operator()<kCount - 1>(). g++ 12 leaves arrays indexed by a loop on the stack
/// even when the loop is unrolled later; with constant indices it does not.
template <std::size_t kCount, class Body>
[[gnu::always_inline]] inline void Unrolled(Body&& body) {
  [&]<std::size_t... i>(std::index_sequence<i...>) __attribute__((always_inline)) {
    (body.template operator()<i>(), ...);
  }
  (std::make_index_sequence<kCount>{});
}

}  // namespace rilievo::matching
