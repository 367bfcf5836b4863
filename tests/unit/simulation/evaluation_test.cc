// The evaluation finds planted errors and planted similarities.
#include "simulation/evaluation.h"

#include <gtest/gtest.h>

#include "base/rng.h"
#include "base/units.h"
#include "simulation/writer.h"

namespace rilievo::simulation {
namespace {

class EvaluationTest : public testing::Test {
 protected:
  static SceneOptions Options() {
    SceneOptions options;
    options.images = 6;
    options.width_px = 600;
    options.height_px = 400;
    options.surface_points = 20000;
    return options;
  }

  /// The truth as a model in a frame of its own: x_model = frame * x_world.
  Model TrueModel(const Similarity3& frame) const {
    Model model;
    for (std::size_t i = 0; i < 6; ++i)
      model.cam_from_world[ImageId(10 + i)] = TransformPose(frame, renderer_.scene().cam_from_world[i]);
    for (const TruePoint& truth : MakeTruePoints(renderer_, 400)) {
      Point point;
      point.position = frame * truth.position_m;
      for (const auto& p : truth.projections)
        point.observations.push_back(
            {{ImageId(static_cast<std::uint32_t>(10 + p.image)), 0}, p.pixel_px, Eigen::Vector2d::Zero()});
      model.points.push_back(point);
    }
    return model;
  }
  std::map<ImageId, std::string> Names() const {
    std::map<ImageId, std::string> names;
    for (std::uint32_t i = 0; i < 6; ++i) names[ImageId(10 + i)] = renderer_.scene().names[i];
    return names;
  }

  Renderer renderer_{MakeScene(Options())};
  Similarity3 frame_{0.37, Eigen::Quaterniond(0.4, -0.2, 0.7, 0.5).normalized(), {3, -8, 1.5}};
};

TEST_F(EvaluationTest, FindsAPlantedSimilarityExactly) {
  const auto errors = EvaluateModel(TrueModel(frame_), Names(), renderer_);
  ASSERT_TRUE(errors);
  EXPECT_NEAR(errors->truth_from_model.scale * frame_.scale, 1, 1e-12);
  EXPECT_LT(errors->truth_from_model.rotation.angularDistance(frame_.rotation.conjugate()), 1e-7);
  EXPECT_EQ(errors->centers_m.count, 6U);
  EXPECT_LT(errors->centers_m.max, 1e-11);
  EXPECT_LT(errors->rotations_deg.max, 1e-9);
  EXPECT_GT(errors->points_m.count, 390U);
  EXPECT_LT(errors->points_m.p95, 1e-8);
  EXPECT_LT(errors->surface_m.max, 1e-6);
  EXPECT_LT(errors->points_own_datum_m.p95, 1e-8);
  EXPECT_NEAR(errors->object_distance_m, 4, 0.4);
}

TEST_F(EvaluationTest, ReportsPlantedErrorsAtTheirSize) {
  Model model = TrueModel(frame_);
  Rng rng(4);
  for (Point& point : model.points) point.position += frame_.rotation * Eigen::Vector3d(0, 0, frame_.scale * 0.003);
  const auto shifted = EvaluateModel(model, Names(), renderer_);
  EXPECT_NEAR(shifted->points_m.median, 0.003, 1e-6);
  EXPECT_LT(shifted->surface_m.median, 0.003);  // along z to the slanted surface: the perpendicular is shorter
  EXPECT_GT(shifted->surface_m.median, 0.001);
  EXPECT_LT(shifted->points_own_datum_m.p95, 1e-6) << "a common shift is datum";

  model = TrueModel(frame_);
  Rigid3& pose = model.cam_from_world.begin()->second;
  pose =
      Rigid3(Eigen::Quaterniond(Eigen::AngleAxisd(DegToRad(0.2), Eigen::Vector3d::UnitX())), Eigen::Vector3d::Zero()) *
      pose;
  const auto turned = EvaluateModel(model, Names(), renderer_);
  EXPECT_NEAR(turned->rotations_deg.max, 0.2, 1e-6);
  EXPECT_LT(turned->centers_m.max, 1e-11) << "turning about the projection centre does not move it";

  pose.translation += pose.rotation * Eigen::Vector3d(frame_.scale * 0.01, 0, 0);  // moves the centre by a centimetre
  const auto moved = EvaluateModel(model, Names(), renderer_);
  EXPECT_GT(moved->centers_m.max, 0.002);
  EXPECT_LT(moved->centers_m.max, 0.01);
  EXPECT_NEAR(moved->center_relative, moved->object_distance_m / moved->centers_m.mean, 1e-9);
}

TEST_F(EvaluationTest, EveryPointIsCounted) {
  Model model = TrueModel(frame_);
  model.points[7].position = Eigen::Vector3d(1e5, 0, 0);  // far off
  model.points[9].observations.clear();
  const auto errors = EvaluateModel(model, Names(), renderer_);
  EXPECT_EQ(errors->surface_m.count, model.points.size());
  EXPECT_GT(errors->surface_m.max, 1e5);
  EXPECT_EQ(errors->points_m.count + errors->points_without_truth, model.points.size());
  EXPECT_EQ(errors->points_without_truth, 1U);
}

TEST_F(EvaluationTest, TooFewImagesAndStrangersAreNotCompared) {
  Model model = TrueModel(frame_);
  auto names = Names();
  names[ImageId(12)] = "other.jpg";
  EXPECT_THROW(EvaluateModel(model, names, renderer_), Error);
  while (model.cam_from_world.size() > 2) model.cam_from_world.erase(std::prev(model.cam_from_world.end()));
  EXPECT_FALSE(EvaluateModel(model, Names(), renderer_));
}

}  // namespace
}  // namespace rilievo::simulation
