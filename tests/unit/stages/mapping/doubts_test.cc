// What speaks against a result: true blocks raise no doubt, each kind of contradiction raises its own.
#include "stages/mapping/doubts.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "tests/support/synthetic_block.h"

namespace rilievo {
namespace {

using mapping::Agreements;
using mapping::Input;
using test::MakeSyntheticBlock;
using test::SyntheticBlock;
using test::SyntheticOptions;

Input InputOf(const SyntheticBlock& b) { return {b.block, b.keypoints, b.colors, b.pairs, b.tracks}; }

mapping::Output Map(const SyntheticBlock& b) {
  SerialRunContext context(5);
  return mapping::Run(InputOf(b), {}, context);
}

/// The model as it truly is, with the tracks `from`, `from + step`, ... as its object points.
Model TrueModel(const SyntheticBlock& b, std::size_t step = 1) {
  Model model;
  for (std::uint32_t i = 0; i < b.block.images.size(); ++i)
    model.cam_from_world.emplace(ImageId(i), b.cam_from_world[i]);
  for (std::size_t t = 0; t < b.tracks.size(); t += step) {
    Point& point = model.points.emplace_back();
    point.position = b.points[b.point_of_track[t]];
    for (const FeatureRef& e : b.tracks[t].elements)
      if (!b.wrong.contains(e)) point.observations.push_back({e, Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()});
  }
  return model;
}

/// A facade whose texture repeats: every match leads to the neighbouring period, `periods` features further.
void ShiftPartners(TwoViewGeometry& g, std::size_t periods) {
  std::vector<std::uint32_t> partners;
  for (const Match& match : g.inliers) partners.push_back(match.second);
  for (std::size_t i = 0; i < g.inliers.size(); ++i) g.inliers[i].second = partners[(i + periods) % partners.size()];
}

bool Mentions(const std::vector<std::string>& lines, const std::string& word) {
  return std::any_of(lines.begin(), lines.end(),
                     [&](const auto& line) { return line.find(word) != std::string::npos; });
}

TEST(Doubts, TrueBlocksRaiseNone) {
  for (const auto object : {test::Object::kRelief, test::Object::kPlane}) {
    SyntheticOptions o;
    o.object = object;
    o.noise_px = 0.5;
    o.wrong_share = 0.05;
    const SyntheticBlock b = MakeSyntheticBlock(o);
    const mapping::Output output = Map(b);
    ASSERT_EQ(output.models.size(), 1u);
    EXPECT_TRUE(output.warnings.empty()) << output.warnings.front();
  }
}

TEST(Doubts, AgreementIsTheShareOfRightMatches) {
  SyntheticOptions o;
  o.noise_px = 0.3;
  SyntheticBlock b = MakeSyntheticBlock(o);
  TwoViewGeometry& g = b.pairs[2];
  const std::size_t wrong = g.inliers.size() / 4;
  for (std::size_t i = 0; i < wrong; ++i) g.inliers[i].second = (g.inliers[i].second + 1) % 1000;
  const auto agreements = Agreements(InputOf(b), b.pairs, TrueModel(b), 4);
  ASSERT_EQ(agreements.size(), b.pairs.size());
  for (std::size_t i = 0; i < agreements.size(); ++i) {
    EXPECT_EQ(agreements[i].pair, b.pairs[i].pair);
    EXPECT_EQ(agreements[i].verified, b.pairs[i].inliers.size());
    EXPECT_LT(agreements[i].rotation_rad, 1e-9);
    // A neighbour in the list lies anywhere in the image: some one in a thousand is within four pixels by chance.
    const double expected = i == 2 ? static_cast<double>(b.pairs[i].inliers.size() - wrong)
                                   : static_cast<double>(b.pairs[i].inliers.size());
    EXPECT_NEAR(static_cast<double>(agreements[i].agreeing), expected, 0.01 * expected) << i;
  }
}

TEST(Doubts, MatchesAlongTheEpipolarLineAreCaughtByTheObjectPoints) {
  // Cameras side by side, features on one image row: every partner satisfies the epipolar geometry.
  SyntheticBlock b;
  const CameraModel camera{.kind = CameraModelKind::kPinhole, .fx = 1000, .fy = 1000, .cx = 500, .cy = 500};
  b.block.cameras.push_back({CameraId(0), camera, 1000, 1000, CalibrationSource::kGiven, "row"});
  b.keypoints.resize(2);
  b.colors.resize(2);
  Model model;
  TwoViewGeometry g;
  g.pair = {ImageId(0), ImageId(1)};
  g.model = TwoViewModel::kEssential;
  g.second_from_first = Rigid3(Eigen::Quaterniond::Identity(), {-1, 0, 0});
  for (std::uint32_t i = 0; i < 2; ++i) {
    Image image;
    image.id = ImageId(i), image.camera_id = CameraId(0), image.name = "row" + std::to_string(i);
    b.block.images.push_back(image);
    model.cam_from_world.emplace(ImageId(i), Rigid3(Eigen::Quaterniond::Identity(), {-static_cast<double>(i), 0, 0}));
  }
  for (std::uint32_t k = 0; k < 40; ++k) {
    Point& point = model.points.emplace_back();
    point.position = {-1.5 + 0.1 * k, 0, 10};
    for (std::uint32_t i = 0; i < 2; ++i) {
      const auto at = camera.Project(model.cam_from_world.at(ImageId(i)) * point.position);
      b.keypoints[i].push_back({static_cast<float>(at->x()), static_cast<float>(at->y()), 2, 0, 0.1F});
      point.observations.push_back({{ImageId(i), k}, *at, Eigen::Vector2d::Zero()});
    }
    if (k >= 1) g.inliers.push_back({k, k - 1});
  }
  const std::vector<TwoViewGeometry> pairs{g};
  const std::vector<Model> models{model};
  EXPECT_EQ(Agreements(InputOf(b), pairs, model, 4)[0].agreeing, 0u);
  const auto doubts = mapping::Doubts(InputOf(b), pairs, models, 4);
  EXPECT_TRUE(Mentions(doubts, "row0 and row1 contradict the orientation: 0 of 39")) << doubts.size();
  // A point of either side is enough.
  for (const std::uint32_t blind : {0u, 1u}) {
    Model half = model;
    for (Point& point : half.points)
      std::erase_if(point.observations, [&](const Observation& o) { return o.feature.image == ImageId(blind); });
    EXPECT_EQ(Agreements(InputOf(b), pairs, half, 4)[0].agreeing, 0u) << blind;
  }
  // Without object points there is nothing but the epipolar lines to hold against them.
  Model bare = model;
  bare.points.clear();
  EXPECT_EQ(Agreements(InputOf(b), pairs, bare, 4)[0].agreeing, 39u);
}

TEST(Doubts, MatchesWithoutObjectPointsAreHeldAgainstTheEpipolarGeometry) {
  SyntheticBlock b = MakeSyntheticBlock({});
  Model model = TrueModel(b, 100000);  // one point
  const auto right = Agreements(InputOf(b), b.pairs, model, 4);
  for (const auto& a : right) EXPECT_EQ(a.agreeing, a.verified);
  Rigid3& turned = model.cam_from_world.at(ImageId(3));
  turned.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitZ())) * turned.rotation;
  const auto wrong = Agreements(InputOf(b), b.pairs, model, 4);
  for (const auto& a : wrong) {
    const bool concerned = a.pair.first == ImageId(3) || a.pair.second == ImageId(3);
    EXPECT_NEAR(a.rotation_rad, concerned ? 0.2 : 0, 1e-6);
    EXPECT_EQ(a.Share() < 0.5, concerned) << a.Share();
  }
}

TEST(Doubts, AContradictedPairIsNamedWithItsNumbers) {
  SyntheticOptions o;
  o.noise_px = 0.3;
  SyntheticBlock b = MakeSyntheticBlock(o);
  TwoViewGeometry& g = b.pairs[0];
  ShiftPartners(g, 7);
  g.second_from_first.rotation =
      Eigen::Quaterniond(Eigen::AngleAxisd(0.25, Eigen::Vector3d::UnitY())) * g.second_from_first.rotation;
  const std::vector<Model> models{TrueModel(b)};
  const auto doubts = mapping::Doubts(InputOf(b), b.pairs, models, 4);
  ASSERT_EQ(doubts.size(), 1u);
  EXPECT_NE(doubts[0].find("IMG_0.jpg and IMG_1.jpg contradict"), std::string::npos) << doubts[0];
  EXPECT_NE(doubts[0].find("of " + std::to_string(g.inliers.size()) + " verified"), std::string::npos) << doubts[0];
  EXPECT_NE(doubts[0].find("14.3 deg"), std::string::npos) << doubts[0];
}

TEST(Doubts, ManyContradictionsAreCutShortAndBlameTheCalibration) {
  SyntheticBlock b = MakeSyntheticBlock({});
  ASSERT_GT(b.pairs.size(), 20u);
  for (TwoViewGeometry& g : b.pairs) ShiftPartners(g, 7);
  const std::vector<Model> models{TrueModel(b)};
  const auto doubts = mapping::Doubts(InputOf(b), b.pairs, models, 4);
  EXPECT_EQ(doubts.size(), 12u);
  EXPECT_TRUE(Mentions(doubts, "calibration"));
  EXPECT_TRUE(Mentions(doubts, "18 more pairs"));
}

TEST(Doubts, ImagesHeldByFewRaysAndModelsThatShouldBeOneAreNamed) {
  SyntheticOptions o;
  o.images = 4;
  o.scenes = 2;
  o.points = 400;
  SyntheticBlock b = MakeSyntheticBlock(o);
  Model first = TrueModel(b), second = first;
  for (std::uint32_t i = 0; i < 4; ++i) {
    first.cam_from_world.erase(ImageId(4 + i));
    second.cam_from_world.erase(ImageId(i));
  }
  const auto of_scene = [](std::uint32_t scene) {
    return [scene](const Point& p) { return p.observations.front().feature.image.value / 4 != scene; };
  };
  std::erase_if(first.points, of_scene(0));
  std::erase_if(second.points, of_scene(1));
  const std::vector<Model> models{first, second};
  EXPECT_TRUE(mapping::Doubts(InputOf(b), b.pairs, models, 4).empty());

  TwoViewGeometry bridge = b.pairs.front();
  bridge.pair = {ImageId(1), ImageId(6)};
  b.pairs.push_back(bridge);
  auto doubts = mapping::Doubts(InputOf(b), b.pairs, models, 4);
  ASSERT_EQ(doubts.size(), 1u);
  EXPECT_NE(doubts[0].find("components 1 and 2 could not be joined although 1 "), std::string::npos) << doubts[0];
  EXPECT_NE(doubts[0].find("IMG_1.jpg and IMG_6.jpg"), std::string::npos) << doubts[0];

  std::size_t kept = 0;
  for (Point& point : first.points)
    std::erase_if(point.observations,
                  [&](const Observation& obs) { return obs.feature.image == ImageId(2) && ++kept > 12; });
  doubts = mapping::Doubts(InputOf(b), b.pairs, std::vector<Model>{first, second}, 4);
  EXPECT_TRUE(Mentions(doubts, "IMG_2.jpg is held by 12 rays only"));
}

}  // namespace
}  // namespace rilievo
