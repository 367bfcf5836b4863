// Object points and projection centres as PLY.
#include "block/io/ply.h"

#include <cstdint>
#include <type_traits>
#include <utility>

#include "block/io/residuals.h"
#include "block/io/text.h"

namespace rilievo::io {
namespace {

/// Writes the values of a vertex in the chosen form.
class VertexWriter {
 public:
  VertexWriter(PlyForm form, std::size_t count, const char* what, const char* properties) : form_(form) {
    text_ = std::string("ply\nformat ") + (form == PlyForm::kBinary ? "binary_little_endian" : "ascii") +
            " 1.0\ncomment rilievo " + what + "\nelement vertex " + std::to_string(count) + "\n" + properties +
            "end_header\n";
  }
  template <class T>
  VertexWriter& Put(T value) {
    if (form_ == PlyForm::kBinary) {
      text_.append(reinterpret_cast<const char*>(&value), sizeof value);
      return *this;
    }
    if (!std::exchange(at_line_start_, false)) text_ += ' ';
    if constexpr (std::is_floating_point_v<T>)
      text_ += ExactText(value);
    else
      text_ += std::to_string(value);
    return *this;
  }
  VertexWriter& Put(const Eigen::Vector3d& v) { return Put(v.x()).Put(v.y()).Put(v.z()); }
  VertexWriter& Put(const Rgb& color) { return Put(color[0]).Put(color[1]).Put(color[2]); }
  void EndVertex() {
    if (form_ == PlyForm::kText) text_ += '\n';
    at_line_start_ = true;
  }
  std::string Take() { return std::move(text_); }

 private:
  PlyForm form_;
  std::string text_;
  bool at_line_start_ = true;
};

constexpr char kPointProperties[] =
    "property double x\nproperty double y\nproperty double z\nproperty uchar red\nproperty uchar green\nproperty uchar "
    "blue\n"
    "property int rays\nproperty double rms_px\n";
constexpr char kCameraProperties[] =
    "property double x\nproperty double y\nproperty double z\nproperty double nx\nproperty double ny\nproperty double "
    "nz\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty int image\n";

}  // namespace

FileSet Ply(const Block& block, const Model& model, PlyForm form) {
  VertexWriter points(form, model.points.size(), "object points", kPointProperties);
  for (const Point& point : model.points) {
    points.Put(point.position).Put(point.color).Put(static_cast<std::int32_t>(point.observations.size()));
    points.Put(RmsResidualPx(block, model, point)).EndVertex();
  }
  VertexWriter cameras(form, model.cam_from_world.size(), "projection centres", kCameraProperties);
  for (const auto& [image, pose] : model.cam_from_world) {
    const Eigen::Vector3d direction = pose.RotationMatrix().row(2);
    cameras.Put(pose.Center())
        .Put(direction)
        .Put(Rgb{255, 0, 0})
        .Put(static_cast<std::int32_t>(image.value))
        .EndVertex();
  }
  return {{"points.ply", points.Take()}, {"cameras.ply", cameras.Take()}};
}

}  // namespace rilievo::io
