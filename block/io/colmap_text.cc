// COLMAP's sparse model as text.
#include <cmath>

#include "block/io/camera_params.h"
#include "block/io/colmap_content.h"
#include "block/io/text.h"

namespace rilievo::io {
namespace {

std::string CamerasText(const ColmapContent& content) {
  std::string text =
      "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of "
      "cameras: " +
      std::to_string(content.cameras.size()) + "\n";
  for (const auto& camera : content.cameras) {
    text += std::to_string(camera.id) + " " + std::string(CameraModelName(camera.model.kind)) + " " +
            std::to_string(camera.width_px) + " " + std::to_string(camera.height_px);
    for (const double value : CameraParams(camera.model)) text += " " + ExactText(value);
    text += "\n";
  }
  return text;
}

std::string ImagesText(const ColmapContent& content) {
  std::string text =
      "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
      "#   POINTS2D[] as (X, Y, POINT3D_ID)\n# Number of images: " +
      std::to_string(content.images.size()) + "\n";
  for (const auto& image : content.images) {
    const auto& q = image.cam_from_world.rotation;
    const auto& t = image.cam_from_world.translation;
    text += std::to_string(image.id);
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) text += " " + ExactText(value);
    text += " " + std::to_string(image.camera_id) + " " + image.name + "\n";
    for (std::size_t i = 0; i < image.points.size(); ++i) {
      const auto& point = image.points[i];
      text += (i ? " " : "") + ExactText(point.position_px.x()) + " " + ExactText(point.position_px.y()) + " ";
      text += point.point_id == kNoColmapPoint ? "-1" : std::to_string(point.point_id);
    }
    text += "\n";
  }
  return text;
}

std::string PointsText(const ColmapContent& content) {
  std::string text =
      "# 3D point list with one line of data per point:\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as "
      "(IMAGE_ID, POINT2D_IDX)\n"
      "# Number of points: " +
      std::to_string(content.points.size()) + "\n";
  for (const auto& point : content.points) {
    text += std::to_string(point.id);
    for (const double value : {point.position.x(), point.position.y(), point.position.z()})
      text += " " + ExactText(value);
    for (const auto value : point.color) text += " " + std::to_string(value);
    text += " " + ExactText(point.error_px);
    for (const auto& [image, index] : point.track) text += " " + std::to_string(image) + " " + std::to_string(index);
    text += "\n";
  }
  return text;
}

/// The numbers of a line, one after the other; every mistake becomes an Error with file and line.
class LineReader {
 public:
  LineReader(const std::string& file, const TextLine& line)
      : file_(file), line_(line), tokens_(SplitTokens(line.text)) {}
  bool AtEnd() const { return next_ == tokens_.size(); }
  Error Bad(const std::string& message) const {
    return {ErrorCode::kInvalidInput, file_, "line " + std::to_string(line_.number) + ": " + message,
            "export the model again"};
  }
  std::string_view Word() {
    if (AtEnd()) throw Bad("ends too early");
    return tokens_[next_++];
  }
  double Number() {
    const auto value = ParseFinite(Word());
    if (!value) throw Bad("'" + std::string(tokens_[next_ - 1]) + "' is not a number");
    return *value;
  }
  long long Integer(long long low, long long high) {
    const auto value = ParseInteger(Word());
    if (!value || *value < low || *value > high)
      throw Bad("'" + std::string(tokens_[next_ - 1]) + "' is not a valid whole number here");
    return *value;
  }
  /// All that is left of the line, blanks inside included.
  std::string Rest() {
    const std::string_view first = Word();
    next_ = tokens_.size();
    return std::string(line_.text.substr(static_cast<std::size_t>(first.data() - line_.text.data())));
  }

 private:
  const std::string& file_;
  const TextLine& line_;
  std::vector<std::string_view> tokens_;
  std::size_t next_ = 0;
};

constexpr long long kMaxId = 0xFFFFFFFELL;

void ReadCameras(const std::string& file, std::string_view text, ColmapContent& content) {
  for (const TextLine& line : SplitLines(text)) {
    if (line.text.empty() || line.text.front() == '#') continue;
    LineReader reader(file, line);
    ColmapContent::CameraRecord camera;
    camera.id = static_cast<std::uint32_t>(reader.Integer(0, kMaxId));
    const std::string name(reader.Word());
    const auto kind = CameraModelKindFromName(name);
    if (!kind) throw reader.Bad("camera model " + name + " is not supported");
    camera.width_px = static_cast<std::uint64_t>(reader.Integer(1, 1'000'000));
    camera.height_px = static_cast<std::uint64_t>(reader.Integer(1, 1'000'000));
    std::vector<double> params(CameraParamCount(*kind));
    for (double& value : params) value = reader.Number();
    if (!reader.AtEnd()) throw reader.Bad("more parameters than " + name + " has");
    camera.model = CameraFromParams(*kind, params);
    content.cameras.push_back(camera);
  }
}

void ReadImages(const std::string& file, std::string_view text, ColmapContent& content) {
  bool expects_points = false;
  for (const TextLine& line : SplitLines(text)) {
    if (line.text.starts_with('#') || (line.text.empty() && !expects_points)) continue;
    LineReader reader(file, line);
    if (std::exchange(expects_points, !expects_points)) {
      while (!reader.AtEnd()) {
        ColmapContent::Point2 point;
        point.position_px.x() = reader.Number();
        point.position_px.y() = reader.Number();
        const long long id = reader.Integer(-1, std::numeric_limits<long long>::max());
        point.point_id = id < 0 ? kNoColmapPoint : static_cast<std::uint64_t>(id);
        content.images.back().points.push_back(point);
      }
      continue;
    }
    ColmapContent::ImageRecord image;
    image.id = static_cast<std::uint32_t>(reader.Integer(0, kMaxId));
    std::array<double, 7> v;
    for (double& value : v) value = reader.Number();
    image.cam_from_world = PoseFromNumbers(v);
    image.camera_id = static_cast<std::uint32_t>(reader.Integer(0, kMaxId));
    image.name = reader.Rest();
    content.images.push_back(std::move(image));
  }
  if (expects_points) content.images.back().points.clear();  // the last image's empty line may be missing
}

void ReadPoints(const std::string& file, std::string_view text, ColmapContent& content) {
  for (const TextLine& line : SplitLines(text)) {
    if (line.text.empty() || line.text.front() == '#') continue;
    LineReader reader(file, line);
    ColmapContent::Point3 point;
    point.id = static_cast<std::uint64_t>(reader.Integer(0, std::numeric_limits<long long>::max()));
    for (int i = 0; i < 3; ++i) point.position[i] = reader.Number();
    for (auto& value : point.color) value = static_cast<std::uint8_t>(reader.Integer(0, 255));
    point.error_px = reader.Number();
    while (!reader.AtEnd()) {
      const auto image = static_cast<std::uint32_t>(reader.Integer(0, kMaxId));
      point.track.emplace_back(image, static_cast<std::uint32_t>(reader.Integer(0, kMaxId)));
    }
    content.points.push_back(std::move(point));
  }
}

}  // namespace

FileSet ColmapText(const Block& block, const Model& model) {
  const ColmapContent content = ContentOf(block, model);
  return {{"cameras.txt", CamerasText(content)},
          {"images.txt", ImagesText(content)},
          {"points3D.txt", PointsText(content)}};
}

ColmapContent ParseColmapText(const FileSet& files) {
  ColmapContent content;
  ReadCameras("cameras.txt", files.at("cameras.txt"), content);
  ReadImages("images.txt", files.at("images.txt"), content);
  ReadPoints("points3D.txt", files.at("points3D.txt"), content);
  return content;
}

}  // namespace rilievo::io
