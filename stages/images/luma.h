// Grey of a colour.
#pragma once

namespace rilievo::images {

/// Y of ITU-R BT.601 in 14-bit fixed point, rounded; exact for grey input.
template <class T>
T Luma(unsigned r, unsigned g, unsigned b) {
  return static_cast<T>((4899U * r + 9617U * g + 1868U * b + 8192U) >> 14);
}

}  // namespace rilievo::images
