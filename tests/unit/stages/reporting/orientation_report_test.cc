// The orientation report against figures worked out by hand and by brute force on an exact model.
#include "stages/reporting/orientation_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <tuple>

namespace rilievo::reporting {
namespace {

constexpr int kWidth = 800, kHeight = 400;

struct Example {
  Block block;
  OrientationResult result;
};

/// Cameras 0, 1, 2 stand 1 apart on the x axis and look along z; image 3 could not be oriented, image 4 not be decoded,
/// and a further file is no image. Point p lies before camera p at distance 1 + p and is seen by the first p + 2
/// cameras.
Example MakeExample() {
  Example e;
  e.block.cameras.push_back(
      {CameraId(0), {.fx = 700, .fy = 710, .cx = 400, .cy = 200}, kWidth, kHeight, CalibrationSource::kGiven, "test"});
  for (std::uint32_t i = 0; i < 5; ++i) {
    Image image;
    image.id = ImageId(i);
    image.camera_id = CameraId(0);
    image.name = "photo_" + std::string(1, static_cast<char>('a' + i)) + ".jpg";
    image.width_px = kWidth, image.height_px = kHeight;
    e.block.images.push_back(image);
    e.result.images.push_back({100 * (i + 1), i == 4 ? "cannot be decoded" : "", i == 4 ? 0 : 0.25 * (i + 1)});
  }
  e.block.quarantined.push_back({"notes.jpg", "is no image"});
  e.result.unoriented.push_back({ImageId(3), "too few object points"});
  Model model;
  for (std::uint32_t i = 0; i < 3; ++i) {
    Rigid3 pose;
    pose.translation = Eigen::Vector3d(-static_cast<double>(i), 0, 0);
    model.cam_from_world[ImageId(i)] = pose;
  }
  for (std::uint32_t p = 0; p < 2; ++p) {
    Point point;
    point.position = {static_cast<double>(p), 0, 1.0 + p};
    for (std::uint32_t i = 0; i < p + 2; ++i) {
      Observation o;
      o.feature = {ImageId(i), p};
      o.measured_px = {10.0 + 100 * i, 390.0 * p};
      o.residual_px = {0.3 * (i + 1), -0.4 * (p + 1)};
      point.observations.push_back(o);
    }
    model.points.push_back(point);
  }
  model.sigma0_px = 0.75;
  model.redundancy = 42;
  e.result.models.push_back(model);
  e.result.pairs = {{{ImageId(0), ImageId(1)}, TwoViewModel::kEssential, RejectionReason::kNone, 50, 40, 0.1, 0.3},
                    {{ImageId(0), ImageId(3)}, TwoViewModel::kRejected, RejectionReason::kTooFewInliers, 9, 5, 0, 0},
                    {{ImageId(1), ImageId(2)}, TwoViewModel::kHomography, RejectionReason::kNone, 30, 20, 0.1, 0.9}};
  return e;
}

TEST(OrientationReport, CountsImagesPairsAndFiles) {
  const Example e = MakeExample();
  const Report report = Summarize(e.block, e.result);
  EXPECT_EQ(report.images, 4u);  // usable ones: the fifth is quarantined
  EXPECT_EQ(report.oriented, 3u);
  EXPECT_EQ(report.features, 1500u);
  EXPECT_EQ(report.pairs, 3u);
  EXPECT_EQ(report.pairs_verified, 2u);
  EXPECT_EQ(report.matches, 89u);
  EXPECT_EQ(report.inliers, 60u) << "those of rejected pairs do not count";
  ASSERT_EQ(report.quarantined.size(), 2u);
  EXPECT_EQ(report.quarantined[0].name, "notes.jpg");
  EXPECT_EQ(report.quarantined[1].name, "photo_e.jpg");
  EXPECT_EQ(report.quarantined[1].reason, "cannot be decoded");
}

TEST(OrientationReport, PointsAnglesAndMultiplicities) {
  const Example e = MakeExample();
  const ModelReport m = Summarize(e.block, e.result).models.at(0);
  EXPECT_EQ(m.points, 2u);
  EXPECT_EQ(m.rays, 5u);
  EXPECT_DOUBLE_EQ(m.mean_multiplicity, 2.5);
  EXPECT_THAT(m.multiplicity, testing::ElementsAre(1, 1, 0, 0, 0, 0, 0, 0));
  // Point 0 at (0, 0, 1): from (0, 0, 0) straight on, from (1, 0, 0) under 45 deg. Point 1 at (1, 0, 2): its outer
  // cameras stand 1 to either side at distance 2.
  const double second_deg = 2 * std::atan(0.5) * 180 / std::numbers::pi;
  EXPECT_NEAR(m.min_angle_deg, 45, 1e-9);
  EXPECT_NEAR(m.max_angle_deg, second_deg, 1e-9);
  EXPECT_NEAR(m.mean_angle_deg, (45 + second_deg) / 2, 1e-9);
  EXPECT_EQ(m.sigma0_px, 0.75);
  EXPECT_EQ(m.redundancy, 42);
}

TEST(OrientationReport, ResidualsByImageAndInAll) {
  const Example e = MakeExample();
  const ModelReport m = Summarize(e.block, e.result).models.at(0);
  double all = 0, largest = 0;
  ASSERT_EQ(m.images.size(), 3u);
  for (std::uint32_t i = 0; i < 3; ++i) {
    double xx = 0, yy = 0, image_largest = 0;
    std::size_t rays = 0;
    for (const Point& point : e.result.models[0].points)
      for (const Observation& o : point.observations) {
        if (o.feature.image != ImageId(i)) continue;
        xx += o.residual_px.x() * o.residual_px.x();
        yy += o.residual_px.y() * o.residual_px.y();
        image_largest = std::max(image_largest, o.residual_px.norm());
        ++rays;
      }
    const ImageReport& image = m.images[i];
    EXPECT_EQ(image.image, ImageId(i));
    EXPECT_EQ(image.rays, rays);
    EXPECT_NEAR(image.rms_x_px, std::sqrt(xx / static_cast<double>(rays)), 1e-12);
    EXPECT_NEAR(image.rms_y_px, std::sqrt(yy / static_cast<double>(rays)), 1e-12);
    EXPECT_NEAR(image.max_residual_px, image_largest, 1e-12);
    EXPECT_EQ(image.center, Eigen::Vector3d(i, 0, 0));
    EXPECT_DOUBLE_EQ(image.coverage, static_cast<double>(rays) / 64)
        << "every ray of the example is in a cell of its own";
    all += xx + yy;
    largest = std::max(largest, image_largest);
  }
  EXPECT_NEAR(m.rms_px, std::sqrt(all / 10), 1e-12) << "of the ten image coordinates";
  EXPECT_NEAR(m.max_residual_px, largest, 1e-12);
}

TEST(OrientationReport, CoverageCountsCellsNotRays) {
  Example e = MakeExample();
  Model& model = e.result.models[0];
  const Point pattern = model.points[0];
  model.points.clear();
  const auto add = [&](double x_px, double y_px) {
    Point point = pattern;
    for (Observation& o : point.observations) o.measured_px = {x_px, y_px};
    model.points.push_back(point);
  };
  for (int k = 0; k < 20; ++k) add(50 + k, 25);  // one cell, 100 x 50 px
  EXPECT_DOUBLE_EQ(Summarize(e.block, e.result).models[0].images[0].coverage, 1.0 / 64);
  add(0, 0), add(kWidth, kHeight);  // the very corners count as inside
  EXPECT_DOUBLE_EQ(Summarize(e.block, e.result).models[0].images[0].coverage, 2.0 / 64);
  for (int x = 0; x < 8; ++x)
    for (int y = 0; y < 8; ++y) add(100 * x + 50, 50 * y + 25);
  const ModelReport m = Summarize(e.block, e.result).models[0];
  EXPECT_DOUBLE_EQ(m.images[0].coverage, 1);
  EXPECT_EQ(m.images[2].rays, 0u) << "an image without rays is still listed";
  EXPECT_EQ(m.images[2].coverage, 0);
  EXPECT_EQ(m.images[2].rms_x_px, 0);
}

TEST(OrientationReport, ManyRaysShareTheLastMultiplicity) {
  Example e = MakeExample();
  Model& model = e.result.models[0];
  for (std::uint32_t n : {9u, 10u, 17u}) {
    Point point;
    point.position = {0, 0, 5};
    for (std::uint32_t i = 0; i < n; ++i) point.observations.push_back({{ImageId(i % 3), 100 + i}, {1, 1}, {0, 0}});
    model.points.push_back(point);
  }
  EXPECT_THAT(Summarize(e.block, e.result).models[0].multiplicity, testing::ElementsAre(1, 1, 0, 0, 0, 0, 0, 3));
}

TEST(OrientationReport, NothingOrientedIsAReportToo) {
  Example e = MakeExample();
  e.result.models.clear();
  const Report report = Summarize(e.block, e.result);
  EXPECT_EQ(report.oriented, 0u);
  EXPECT_THAT(ToText(report, e.block, e.result, {}), testing::HasSubstr("0 of 4 images"));
  e.result.models.emplace_back();  // nor is a model without points a division by nothing
  const ModelReport empty = Summarize(e.block, e.result).models.at(0);
  for (const double value :
       {empty.mean_multiplicity, empty.rms_px, empty.min_angle_deg, empty.mean_angle_deg, empty.max_angle_deg})
    EXPECT_EQ(value, 0);
}

std::size_t Occurrences(const std::string& text, const std::string& word) {
  std::size_t count = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++count;
  return count;
}

TEST(OrientationReport, TextNamesEveryImageOnceAndEveryWarning) {
  const Example e = MakeExample();
  const std::string text = ToText(Summarize(e.block, e.result), e.block, e.result, {"the focal length is a guess"});
  for (const Image& image : e.block.images) EXPECT_EQ(Occurrences(text, image.name), 1u) << image.name << "\n" << text;
  EXPECT_EQ(Occurrences(text, "notes.jpg: is no image"), 1u);
  EXPECT_EQ(Occurrences(text, "photo_d.jpg: too few object points (400 features, cover 100.0 %)"), 1u);
  for (const auto& [name, features, cover] :
       {std::tuple{"photo_a.jpg", " 100 ", " 25.0 %"}, {"photo_c.jpg", " 300 ", " 75.0 %"}}) {
    const std::size_t end = text.find(name), begin = text.rfind('\n', end);
    const std::string line = text.substr(begin, end - begin);
    EXPECT_LT(line.find(features), line.find(cover)) << line;
    EXPECT_NE(line.find(cover), std::string::npos) << line;
  }
  EXPECT_THAT(text, testing::HasSubstr("WARNING: the focal length is a guess"));
  EXPECT_THAT(text, testing::HasSubstr("3 of 4 images"));
}

TEST(OrientationReport, JsonPutsEveryImageInOnePlaceAndAgreesWithTheSummary) {
  const Example e = MakeExample();
  const Report report = Summarize(e.block, e.result);
  const nlohmann::json json = nlohmann::json::parse(ToJson(report, e.block, e.result, {"w"}).dump());
  std::multiset<std::string> placed, expected{"notes.jpg"};
  for (const auto& model : json["models"])
    for (const auto& image : model["images"]) placed.insert(image["name"].get<std::string>());
  for (const char* kind : {"unoriented", "quarantined"})
    for (const auto& entry : json[kind]) placed.insert(entry["name"].get<std::string>());
  for (const Image& image : e.block.images) expected.insert(image.name);
  EXPECT_EQ(placed, expected);
  ASSERT_EQ(json["image_list"].size(), 5u);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(json["image_list"][i]["features"], 100 * (i + 1));
    EXPECT_EQ(json["image_list"][i]["feature_coverage"], e.result.images[i].coverage);
  }
  EXPECT_EQ(json["pair_list"].size(), 3u);
  EXPECT_EQ(json["oriented"], 3);
  EXPECT_EQ(json["warnings"], nlohmann::json({"w"}));
  EXPECT_EQ(json["cameras"][0]["fy_px"], 710);
  const auto& model = json["models"][0];
  EXPECT_EQ(model["rms_px"].get<double>(), report.models[0].rms_px);
  EXPECT_EQ(model["intersection_angle_deg"]["max"].get<double>(), report.models[0].max_angle_deg);
  EXPECT_EQ(model["images"][2]["center"], nlohmann::json({2.0, 0.0, 0.0}));
  EXPECT_EQ(model["images"][2]["cam_from_world"]["translation"], nlohmann::json({-2.0, 0.0, 0.0}));
}

}  // namespace
}  // namespace rilievo::reporting
