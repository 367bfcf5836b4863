// Mapping goes on from any of its checkpoints and gives every bit that it gives when it is left alone.
#include <gtest/gtest.h>

#include "block/io/serialize_block.h"
#include "stages/mapping/mapper_state.h"
#include "stages/mapping/mapping.h"
#include "tests/support/synthetic_block.h"

namespace rilievo {
namespace {

using test::MakeSyntheticBlock;
using test::SyntheticBlock;

using Bytes = std::vector<std::byte>;

/// Gives `last`, and remembers all that is kept after it.
class Recorder : public Checkpoints {
 public:
  explicit Recorder(std::optional<Bytes> last = std::nullopt) : last_(std::move(last)) {}
  std::optional<Bytes> Last() override { return last_; }
  void Keep(std::span<const std::byte> state) override { kept.emplace_back(state.begin(), state.end()); }
  std::vector<Bytes> kept;

 private:
  std::optional<Bytes> last_;
};

struct Mapped {
  Bytes result;
  std::vector<std::string> warnings;
  std::size_t taken_over = 0;
};

Mapped Map(const SyntheticBlock& b, Checkpoints& checkpoints) {
  SerialRunContext context(5);
  mapping::Output output = mapping::Run({b.block, b.keypoints, b.colors, b.pairs, b.tracks}, {}, checkpoints, context);
  return {io::Serialize(io::MappingResult{std::move(output.models), std::move(output.unoriented)}), output.warnings,
          output.images_taken_over};
}

/// Goes on from every checkpoint of an undisturbed run.
void ExpectSameFromEveryCheckpoint(const SyntheticBlock& b, std::size_t least_checkpoints) {
  Recorder alone;
  const Mapped whole = Map(b, alone);
  ASSERT_GE(alone.kept.size(), least_checkpoints);
  std::size_t mapped_before = 0;
  for (std::size_t i = 0; i < alone.kept.size(); ++i) {
    Recorder rest(alone.kept[i]);
    const Mapped again = Map(b, rest);
    EXPECT_TRUE(again.result == whole.result) << "from checkpoint " << i;
    EXPECT_EQ(again.warnings, whole.warnings);
    EXPECT_GE(again.taken_over, 2u) << i;
    mapped_before = std::max(mapped_before, again.taken_over);
    const std::vector<Bytes> expected(alone.kept.begin() + static_cast<std::ptrdiff_t>(i) + 1, alone.kept.end());
    EXPECT_TRUE(rest.kept == expected) << "the checkpoints after " << i;
  }
  EXPECT_EQ(mapped_before, b.block.images.size());
}

TEST(MappingCheckpoints, OneModel) {
  ExpectSameFromEveryCheckpoint(MakeSyntheticBlock({.images = 10, .noise_px = 0.4, .wrong_share = 0.05}), 6);
}

TEST(MappingCheckpoints, SeveralModels) {
  ExpectSameFromEveryCheckpoint(MakeSyntheticBlock({.images = 6, .points = 600, .noise_px = 0.4, .scenes = 2}), 8);
}

TEST(MappingCheckpoints, BytesOfAnotherBlockAreRefused) {
  const SyntheticBlock small = MakeSyntheticBlock({.images = 6}), large = MakeSyntheticBlock({.images = 8});
  Recorder alone;
  Map(small, alone);
  ASSERT_FALSE(alone.kept.empty());
  Recorder wrong(alone.kept.back());
  EXPECT_THROW(Map(large, wrong), Error);
}

}  // namespace
}  // namespace rilievo
