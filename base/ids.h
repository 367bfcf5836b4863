// Strong integer identifiers: an ImageId cannot be passed where a CameraId is meant.
#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <limits>

namespace rilievo {

/// An index into the list of things named by Tag; `kNone` marks "no such thing".
template <class Tag>
struct Id {
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  std::uint32_t value = kNone;

  constexpr Id() = default;
  constexpr explicit Id(std::uint32_t v) : value(v) {}
  constexpr bool IsValid() const { return value != kNone; }
  friend constexpr auto operator<=>(Id, Id) = default;
};

using ImageId = Id<struct ImageTag>;
using CameraId = Id<struct CameraTag>;
using TrackId = Id<struct TrackTag>;
using TaskId = Id<struct TaskTag>;

}  // namespace rilievo

template <class Tag>
struct std::hash<rilievo::Id<Tag>> {
  std::size_t operator()(rilievo::Id<Tag> id) const noexcept { return std::hash<std::uint32_t>{}(id.value); }
};
