// COLMAP's sparse model as little-endian binary.
#include <bit>
#include <cmath>
#include <cstddef>

#include "base/serialize.h"
#include "block/io/camera_params.h"
#include "block/io/colmap_content.h"

namespace rilievo::io {
namespace {

constexpr std::array<std::pair<CameraModelKind, std::int32_t>, 6> kModelIds{{{CameraModelKind::kSimplePinhole, 0},
                                                                             {CameraModelKind::kPinhole, 1},
                                                                             {CameraModelKind::kSimpleRadial, 2},
                                                                             {CameraModelKind::kRadial, 3},
                                                                             {CameraModelKind::kOpenCv, 4},
                                                                             {CameraModelKind::kFullOpenCv, 6}}};

std::string Text(ByteWriter& writer) {
  const auto bytes = writer.Take();
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::string CamerasBinary(const ColmapContent& content) {
  ByteWriter out;
  out.Put<std::uint64_t>(content.cameras.size());
  for (const auto& camera : content.cameras) {
    out.Put(camera.id);
    for (const auto& [kind, id] : kModelIds)
      if (kind == camera.model.kind) out.Put(id);
    out.Put(camera.width_px);
    out.Put(camera.height_px);
    for (const double value : CameraParams(camera.model)) out.Put(value);
  }
  return Text(out);
}

std::string ImagesBinary(const ColmapContent& content) {
  ByteWriter out;
  out.Put<std::uint64_t>(content.images.size());
  for (const auto& image : content.images) {
    const auto& q = image.cam_from_world.rotation;
    const auto& t = image.cam_from_world.translation;
    out.Put(image.id);
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) out.Put(value);
    out.Put(image.camera_id);
    for (const char c : image.name) out.Put(c);
    out.Put('\0');
    out.Put<std::uint64_t>(image.points.size());
    for (const auto& point : image.points) {
      out.Put(point.position_px.x());
      out.Put(point.position_px.y());
      out.Put(point.point_id);
    }
  }
  return Text(out);
}

std::string PointsBinary(const ColmapContent& content) {
  ByteWriter out;
  out.Put<std::uint64_t>(content.points.size());
  for (const auto& point : content.points) {
    out.Put(point.id);
    for (int i = 0; i < 3; ++i) out.Put(static_cast<double>(point.position[i]));
    out.Put(point.color);
    out.Put(point.error_px);
    out.Put<std::uint64_t>(point.track.size());
    for (const auto& [image, index] : point.track) {
      out.Put(image);
      out.Put(index);
    }
  }
  return Text(out);
}

double Finite(ByteReader& in) {
  const auto value = in.Get<double>();
  if (!std::isfinite(value)) throw Error(ErrorCode::kInvalidInput, "", "a number is not finite");
  return value;
}

void ReadCameras(ByteReader& in, ColmapContent& content) {
  for (auto n = in.Get<std::uint64_t>(); n > 0; --n) {
    ColmapContent::CameraRecord camera;
    camera.id = in.Get<std::uint32_t>();
    const auto model_id = in.Get<std::int32_t>();
    camera.width_px = in.Get<std::uint64_t>();
    camera.height_px = in.Get<std::uint64_t>();
    if (camera.width_px > 1'000'000 || camera.height_px > 1'000'000)
      throw Error(ErrorCode::kInvalidInput, "", "impossible image size");
    std::optional<CameraModelKind> kind;
    for (const auto& [k, id] : kModelIds)
      if (id == model_id) kind = k;
    if (!kind)
      throw Error(ErrorCode::kUnsupported, "", "camera model " + std::to_string(model_id) + " is not supported");
    std::vector<double> params(CameraParamCount(*kind));
    for (double& value : params) value = Finite(in);
    camera.model = CameraFromParams(*kind, params);
    content.cameras.push_back(camera);
  }
}

void ReadImages(ByteReader& in, ColmapContent& content) {
  for (auto n = in.Get<std::uint64_t>(); n > 0; --n) {
    ColmapContent::ImageRecord image;
    image.id = in.Get<std::uint32_t>();
    std::array<double, 7> v;
    for (double& value : v) value = Finite(in);
    image.cam_from_world = PoseFromNumbers(v);
    image.camera_id = in.Get<std::uint32_t>();
    for (char c; (c = in.Get<char>()) != '\0';) image.name += c;
    for (auto k = in.Get<std::uint64_t>(); k > 0; --k) {
      ColmapContent::Point2 point;
      point.position_px.x() = Finite(in);
      point.position_px.y() = Finite(in);
      point.point_id = in.Get<std::uint64_t>();
      image.points.push_back(point);
    }
    content.images.push_back(std::move(image));
  }
}

void ReadPoints(ByteReader& in, ColmapContent& content) {
  for (auto n = in.Get<std::uint64_t>(); n > 0; --n) {
    ColmapContent::Point3 point;
    point.id = in.Get<std::uint64_t>();
    for (int i = 0; i < 3; ++i) point.position[i] = Finite(in);
    point.color = in.Get<Rgb>();
    point.error_px = Finite(in);
    for (auto k = in.Get<std::uint64_t>(); k > 0; --k) {
      const auto image = in.Get<std::uint32_t>();
      point.track.emplace_back(image, in.Get<std::uint32_t>());
    }
    content.points.push_back(std::move(point));
  }
}

template <class Read>
void ReadFile(const FileSet& files, const std::string& name, ColmapContent& content, Read read) {
  const std::string& bytes = files.at(name);
  ByteReader in(std::as_bytes(std::span(bytes)));
  try {
    read(in, content);
    if (!in.AtEnd()) throw Error(ErrorCode::kInvalidInput, "", "has bytes after its end");
  } catch (const Error& error) {
    throw Error(error.code(), name, error.message(), "export the model again");
  }
}

}  // namespace

FileSet ColmapBinary(const Block& block, const Model& model) {
  const ColmapContent content = ContentOf(block, model);
  return {{"cameras.bin", CamerasBinary(content)},
          {"images.bin", ImagesBinary(content)},
          {"points3D.bin", PointsBinary(content)}};
}

ColmapContent ParseColmapBinary(const FileSet& files) {
  ColmapContent content;
  ReadFile(files, "cameras.bin", content, ReadCameras);
  ReadFile(files, "images.bin", content, ReadImages);
  ReadFile(files, "points3D.bin", content, ReadPoints);
  return content;
}

}  // namespace rilievo::io
