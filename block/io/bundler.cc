// Bundler's file format v0.3. Bundler's camera looks along -z with y up: rows 2 and 3 of [R|t] change sign.
#include "block/io/bundler.h"

#include <cmath>
#include <limits>
#include <optional>

#include "base/error.h"
#include "block/io/text.h"

namespace rilievo::io {
namespace {

/// Bundler's own camera: what it projects is f (1 + k1 r2 + k2 r2^2) (x, y) about the image's middle.
bool IsBundlerCamera(const Camera& camera) {
  const CameraModel& m = camera.model;
  return m.fx == m.fy && m.cx == 0.5 * camera.width_px && m.cy == 0.5 * camera.height_px && m.p1 == 0 && m.p2 == 0 &&
         m.k3 == 0 && m.k4 == 0 && m.k5 == 0 && m.k6 == 0;
}

/// The measurement about the image's middle (y down) as the written camera sees it.
std::optional<Eigen::Vector2d> CenteredPx(const Camera& camera, const Eigen::Vector2d& measured_px) {
  if (IsBundlerCamera(camera)) return measured_px - Eigen::Vector2d(camera.model.cx, camera.model.cy);
  const auto ideal = camera.model.Normalize(measured_px);
  if (!ideal) return std::nullopt;
  return camera.model.fx * *ideal;
}

std::string CameraText(const Block& block, const Model& model, const Image& image) {
  const auto pose = model.cam_from_world.find(image.id);
  if (pose == model.cam_from_world.end()) return "0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n";
  const Camera& camera = block.camera_of(image.id);
  const bool native = IsBundlerCamera(camera);
  std::string text = ExactText(camera.model.fx) + " " + ExactText(native ? camera.model.k1 : 0) + " " +
                     ExactText(native ? camera.model.k2 : 0) + "\n";
  const Eigen::Vector3d sign(1, -1, -1);
  const Eigen::Matrix3d rotation = sign.asDiagonal() * pose->second.RotationMatrix();
  const Eigen::Vector3d translation = sign.asDiagonal() * pose->second.translation;
  for (int row = 0; row < 3; ++row)
    text += ExactText(rotation(row, 0)) + " " + ExactText(rotation(row, 1)) + " " + ExactText(rotation(row, 2)) + "\n";
  return text + ExactText(translation.x()) + " " + ExactText(translation.y()) + " " + ExactText(translation.z()) + "\n";
}

std::string PointText(const Block& block, const Point& point) {
  std::string text = ExactText(point.position.x()) + " " + ExactText(point.position.y()) + " " +
                     ExactText(point.position.z()) + "\n" + std::to_string(point.color[0]) + " " +
                     std::to_string(point.color[1]) + " " + std::to_string(point.color[2]) + "\n";
  std::string views;
  int count = 0;
  for (const Observation& observation : point.observations) {
    const ImageId image = observation.feature.image;
    const auto centered = CenteredPx(block.camera_of(image), observation.measured_px);
    if (!centered) continue;
    views += " " + std::to_string(image.value) + " " + std::to_string(observation.feature.feature) + " " +
             ExactText(centered->x()) + " " + ExactText(-centered->y());
    ++count;
  }
  return text + std::to_string(count) + views + "\n";
}

/// Numbers of a whole file, one after the other.
class TokenReader {
 public:
  TokenReader(const std::string& name, std::string_view content)
      : name_(name), tokens_(SplitTokens(content, " \t\r\n")) {}
  std::size_t Remaining() const { return tokens_.size() - next_; }
  Error Bad(const std::string& message) const {
    return {ErrorCode::kInvalidInput, name_, message, "export the file again"};
  }
  double Number() {
    const auto value = ParseFinite(Next());
    if (!value) throw Bad("'" + std::string(tokens_[next_ - 1]) + "' is not a number");
    return *value;
  }
  std::uint32_t Index(std::uint64_t below) {
    const auto value = ParseInteger(Next());
    if (!value || *value < 0 || static_cast<std::uint64_t>(*value) >= below)
      throw Bad("'" + std::string(tokens_[next_ - 1]) + "' is out of range");
    return static_cast<std::uint32_t>(*value);
  }
  /// A count of things of at least `tokens` tokens each.
  std::uint32_t Count(std::size_t tokens) { return Index(Remaining() / tokens + 1); }

 private:
  std::string_view Next() {
    if (next_ == tokens_.size()) throw Bad("ends too early");
    return tokens_[next_++];
  }
  const std::string& name_;
  std::vector<std::string_view> tokens_;
  std::size_t next_ = 0;
};

BundlerScene::Camera ReadCamera(TokenReader& in) {
  BundlerScene::Camera camera;
  camera.focal_px = in.Number();
  camera.k1 = in.Number();
  camera.k2 = in.Number();
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
  for (int i = 0; i < 9; ++i) rotation(i / 3, i % 3) = in.Number();
  for (int i = 0; i < 3; ++i) translation[i] = in.Number();
  if (camera.focal_px == 0) return camera;
  const Eigen::Vector3d sign(1, -1, -1);
  camera.cam_from_world =
      Rigid3(Eigen::Matrix3d(sign.asDiagonal() * rotation), Eigen::Vector3d(sign.asDiagonal() * translation));
  return camera;
}

BundlerScene::Point ReadPoint(TokenReader& in, std::size_t cameras) {
  BundlerScene::Point point;
  for (int i = 0; i < 3; ++i) point.position[i] = in.Number();
  for (auto& value : point.color) value = static_cast<std::uint8_t>(in.Index(256));
  point.measurements.resize(in.Count(4));
  for (auto& measurement : point.measurements) {
    measurement.camera = in.Index(cameras);
    measurement.key = in.Index(std::numeric_limits<std::uint32_t>::max());
    measurement.centered_px.x() = in.Number();
    measurement.centered_px.y() = -in.Number();
  }
  return point;
}

}  // namespace

FileSet BundlerText(const Block& block, const Model& model) {
  std::string bundle = "# Bundle file v0.3\n" + std::to_string(block.images.size()) + " " +
                       std::to_string(model.points.size()) + "\n",
              list;
  for (const Image& image : block.images) {
    bundle += CameraText(block, model, image);
    list += image.name + "\n";
  }
  for (const Point& point : model.points) bundle += PointText(block, point);
  return {{"bundle.out", std::move(bundle)}, {"list.txt", std::move(list)}};
}

BundlerScene ReadBundler(const std::string& name, const std::string& content) {
  const auto end = content.find('\n');
  if (end == std::string::npos || Trim(std::string_view(content).substr(0, end)) != "# Bundle file v0.3")
    throw Error(ErrorCode::kInvalidInput, name, "does not start with '# Bundle file v0.3'",
                "give a Bundler file of that version");
  TokenReader in(name, std::string_view(content).substr(end));
  BundlerScene scene;
  scene.cameras.resize(in.Count(15));
  scene.points.resize(in.Count(7));
  for (auto& camera : scene.cameras) camera = ReadCamera(in);
  for (auto& point : scene.points) point = ReadPoint(in, scene.cameras.size());
  if (in.Remaining() > 0) throw in.Bad("goes on after its last point");
  return scene;
}

}  // namespace rilievo::io
