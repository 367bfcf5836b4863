// Where a long step keeps its state, so that it goes on from there after the program was ended.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace rilievo {

/// The state must be all that the rest of the step depends on beside its inputs: a step that goes on gives the same
/// bytes as one that was left alone. Kept at points that the work fixes, never by time.
class Checkpoints {
 public:
  virtual ~Checkpoints() = default;
  /// The last state kept by an earlier run of this step on the same inputs, or none.
  virtual std::optional<std::vector<std::byte>> Last() = 0;
  virtual void Keep(std::span<const std::byte> state) = 0;
};

/// For steps that need not go on: tests, tools.
class NoCheckpoints : public Checkpoints {
 public:
  std::optional<std::vector<std::byte>> Last() override { return std::nullopt; }
  void Keep(std::span<const std::byte>) override {}
};

}  // namespace rilievo
