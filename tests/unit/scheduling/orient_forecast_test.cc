// What is still to come follows from what images and pairs have turned out to hold.
#include "scheduling/orient_forecast.h"

#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <stdexcept>

#include "scheduling/orient_costs.h"
#include "scheduling/orient_plan.h"

namespace rilievo::scheduling {
namespace {

class NoPixels : public PixelSource {
 public:
  GreyImage Load(const std::string&, bool) const override { return {}; }
  std::uint64_t LoadPeakBytes(const Image&, bool) const override { return 1; }
};

Block MakeBlock(std::size_t images) {
  Block block;
  block.cameras.push_back({.id = CameraId(0), .model = {}, .width_px = 3000, .height_px = 2000, .label = ""});
  for (std::uint32_t i = 0; i < images; ++i) {
    Image image;
    image.id = ImageId(i);
    image.camera_id = CameraId(0);
    image.name = std::to_string(i) + ".jpg";
    image.width_px = 3000;
    image.height_px = 2000;
    image.content.bytes[0] = static_cast<std::uint8_t>(i + 1);
    block.images.push_back(image);
  }
  return block;
}

class Forecast : public ::testing::Test {
 protected:
  explicit Forecast(Network network = Network::kSparse) {
    OrientOptions options;
    options.network = network;
    run_ = std::make_shared<OrientRun>(block_, pixels_, nullptr, store_, options, 0);
    plan_ = MakeOrientPlan(run_);
    forecast_.emplace(*run_, 2);
    for (std::uint32_t i = 0; i < plan_.size(); ++i) forecast_->OnTaskAdded(TaskId(i), plan_.task(TaskId(i)));
  }
  void Finish(TaskId id) {
    engine::TaskOutcome outcome;
    outcome.state = engine::TaskState::kDone;
    forecast_->OnTaskFinished(id, plan_.task(id), outcome, {});
  }
  engine::StageForecast Of(const std::string& stage) {
    for (const auto& s : forecast_->Forecast().stages)
      if (s.stage == stage) return s;
    throw std::out_of_range(stage);
  }

  Block block_ = MakeBlock(10);
  NoPixels pixels_;
  engine::ArtifactStore store_ = engine::ArtifactStore::ForReading("/nonexistent/rilievo");
  std::shared_ptr<OrientRun> run_;
  engine::Plan plan_;
  std::optional<OrientForecast> forecast_;
};

class GuidedForecast : public Forecast {
 protected:
  GuidedForecast() : Forecast(Network::kGuided) {}
};

TEST_F(Forecast, MatchingGoesWithTheSquareOfTheFeaturesFound) {
  EXPECT_EQ(Of("pairs").scale, 1);
  const auto usual = static_cast<std::uint32_t>(UsualFeatures(*run_, block_.images[0]));
  run_->images[0].features = usual / 2;
  Finish(run_->feature_tasks[0]);
  EXPECT_NEAR(Of("pairs").scale, 0.25, 1e-3);
  run_->images[1].features = 3 * (usual / 2);
  Finish(run_->feature_tasks[1]);
  EXPECT_NEAR(Of("pairs").scale, 1, 1e-3);
}

TEST_F(Forecast, TheOrientationIsThereBeforeItsTaskAndGoesWithThePairs) {
  const auto usual = Of("orientation");
  EXPECT_TRUE(usual.comes_last);
  EXPECT_GT(usual.more_work, 0);
  // Every image as usual, no pair with a match: hardly any work; every pair with all features: more than usual.
  std::vector<double> work;
  for (const bool matched : {false, true}) {
    forecast_.emplace(*run_, 2);
    for (std::uint32_t i = 0; i < plan_.size(); ++i) forecast_->OnTaskAdded(TaskId(i), plan_.task(TaskId(i)));
    for (std::size_t i = 0; i < run_->tiles.size(); ++i) {
      run_->tiles[i]->pairs.clear();
      for (const ImagePair& pair : run_->tiles[i]->tile.pairs) {
        PairSummary summary;
        summary.pair = pair;
        summary.inliers = matched ? 5000 : 0;
        run_->tiles[i]->pairs.push_back(summary);
      }
      Finish(run_->tile_tasks[i]);
    }
    work.push_back(Of("orientation").more_work);
  }
  EXPECT_LT(work[0], 0.1 * usual.more_work);
  EXPECT_GE(work[1], usual.more_work);
}

TEST_F(Forecast, ARunThatEndsWithThePairsHasNoOrientation) {
  run_->goal = Goal::kPairs;
  EXPECT_EQ(Of("orientation").more_work, 0);
}

TEST_F(Forecast, AllPairsOfASparseBlockAreInThePlan) { EXPECT_EQ(Of("pairs").more_work, 0); }

TEST_F(GuidedForecast, PairsOfAGuidedBlockAreToCome) { EXPECT_GT(Of("pairs").more_work, 0); }

}  // namespace
}  // namespace rilievo::scheduling
