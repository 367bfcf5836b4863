// Where mapping stands: with its inputs, all that the rest of it depends on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "block/model.h"
#include "stages/mapping/reconstruction.h"

namespace rilievo::mapping {

/// A model that grows from a seed.
struct GrowthState {
  Reconstruction model;
  std::uint32_t phase = 0;  ///< see Grow
  // Of the images added under the present bar; empty and zero before its first.
  std::vector<std::uint32_t> failed_at;            ///< per image: what it had to offer when its resection failed
  std::uint64_t images_then = 0, points_then = 0;  ///< of the model, after the last global adjustment
  std::uint32_t added = 0;
};

/// The last adjustments of a grown model.
struct FinishState {
  Reconstruction model;
  std::uint32_t step = 0;  ///< see Finish
};

/// Random numbers are keyed by work item: they have no state.
struct MapperState {
  std::vector<std::uint8_t> available;  ///< per image: 1 = in no model yet
  std::vector<Model> models;            ///< finished, in the order of finishing
  // The model in work: its seeds, the one that grows, and the best so far.
  std::uint32_t next_seed = 0, starts = 0, growths = 0;
  std::optional<GrowthState> growing;
  std::optional<Reconstruction> best;
  std::optional<FinishState> finishing;

  /// Images in finished models and in the one in work.
  std::size_t NumMapped() const;
};

/// Every bit of the state. Size: a byte a ray and 25 a track for each model in work, and the finished models.
std::vector<std::byte> Serialize(const MapperState& state);
/// The state again, on the same tie points and seed. Throws Error(kInvalidInput) for bytes of anything else.
MapperState DeserializeState(std::span<const std::byte> bytes, const TieBlock& ties, std::uint64_t seed);

}  // namespace rilievo::mapping
