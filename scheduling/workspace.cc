// Reads and writes run.json.
#include "scheduling/workspace.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <system_error>
#include <utility>

namespace rilievo::scheduling {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

constexpr const char* kRecordName = "run.json";
constexpr const char* kFormerName = "former-run.json";
constexpr const char* kArtifacts = "artifacts";

template <class S>
json OptionsToJson(const S& options, std::span<const OptionDeclaration<S>> declarations) {
  json out = json::object();
  for (const auto& d : declarations) out[std::string(d.name)] = OptionValueText(options, d);
  return out;
}

template <class S>
S OptionsFromJson(const json& in, std::span<const OptionDeclaration<S>> declarations) {
  S options;
  for (const auto& d : declarations)
    if (const auto it = in.find(std::string(d.name)); it != in.end())
      SetOptionValue(options, d, it->template get<std::string>());
  return options;
}

/// "0 1, 0 2, 7 9": one text instead of a line a number.
std::string PairsToText(const std::vector<ImagePair>& pairs) {
  std::string text;
  for (const ImagePair& pair : pairs)
    text += (text.empty() ? "" : ", ") + std::to_string(pair.first.value) + " " + std::to_string(pair.second.value);
  return text;
}

std::vector<ImagePair> PairsFromText(const std::string& list) {
  std::istringstream text(list);
  std::vector<ImagePair> pairs;
  for (std::uint32_t first = 0, second = 0; text >> first >> second; text.ignore(1))
    pairs.push_back({ImageId(first), ImageId(second)});
  return pairs;
}

json ToJson(const OrientOptions& o) {
  return {{"network", NetworkName(o.network)},
          {"pairs", OptionsToJson(o.pairs, PairOptionDeclarations())},
          {"listed_pairs", PairsToText(o.listed)},
          {"features", OptionsToJson(o.features, features::OptionDeclarations())},
          {"matching", OptionsToJson(o.matching, matching::OptionDeclarations())},
          {"verification", OptionsToJson(o.verification, verification::OptionDeclarations())},
          {"tracks", OptionsToJson(o.tracks, tracks::OptionDeclarations())},
          {"mapping", OptionsToJson(o.mapping, mapping::OptionDeclarations())}};
}

OrientOptions OptionsFromJson(const json& in) {
  OrientOptions o;
  const auto network = NetworkFromName(in.at("network").get<std::string>());
  if (!network) throw Error(ErrorCode::kInvalidInput, "", "unknown block type in the record");
  o.network = *network;
  if (in.contains("pairs")) o.pairs = OptionsFromJson(in.at("pairs"), PairOptionDeclarations());  // else of before it
  if (in.contains("listed_pairs")) o.listed = PairsFromText(in.at("listed_pairs"));
  o.features = OptionsFromJson(in.at("features"), features::OptionDeclarations());
  o.matching = OptionsFromJson(in.at("matching"), matching::OptionDeclarations());
  o.verification = OptionsFromJson(in.at("verification"), verification::OptionDeclarations());
  if (in.contains("tracks")) o.tracks = OptionsFromJson(in.at("tracks"), tracks::OptionDeclarations());
  o.mapping = OptionsFromJson(in.at("mapping"), mapping::OptionDeclarations());
  return o;
}

json ToJson(const Camera& c) {
  const CameraModel& m = c.model;
  return {{"model", CameraModelName(m.kind)},
          {"width_px", c.width_px},
          {"height_px", c.height_px},
          {"label", c.label},
          {"source", c.source == CalibrationSource::kGiven  ? "given"
                     : c.source == CalibrationSource::kExif ? "exif"
                                                            : "guessed"},
          {"parameters", {m.fx, m.fy, m.cx, m.cy, m.k1, m.k2, m.p1, m.p2, m.k3, m.k4, m.k5, m.k6}}};
}

Camera CameraFromJson(const json& in, CameraId id) {
  Camera c;
  c.id = id;
  c.width_px = in.at("width_px");
  c.height_px = in.at("height_px");
  c.label = in.at("label");
  const std::string source = in.at("source");
  c.source = source == "given"  ? CalibrationSource::kGiven
             : source == "exif" ? CalibrationSource::kExif
                                : CalibrationSource::kGuessed;
  const auto kind = CameraModelKindFromName(in.at("model").get<std::string>());
  if (!kind) throw Error(ErrorCode::kInvalidInput, "", "unknown camera model in the record");
  c.model.kind = *kind;
  const auto p = in.at("parameters").get<std::vector<double>>();
  CameraModel& m = c.model;
  double* const targets[] = {&m.fx, &m.fy, &m.cx, &m.cy, &m.k1, &m.k2, &m.p1, &m.p2, &m.k3, &m.k4, &m.k5, &m.k6};
  for (std::size_t i = 0; i < std::size(targets); ++i) *targets[i] = p.at(i);
  return c;
}

Sha256Digest DigestFromHex(const std::string& hex) {
  Sha256Digest digest;
  if (hex.size() != 64) throw Error(ErrorCode::kInvalidInput, "", "a content digest in the record is damaged");
  for (std::size_t i = 0; i < 32; ++i)
    digest.bytes[i] = static_cast<std::uint8_t>(std::stoul(hex.substr(2 * i, 2), nullptr, 16));
  return digest;
}

json ToJson(const Image& i) {
  json out = {{"name", i.name},
              {"camera", i.camera_id.value},
              {"width_px", i.width_px},
              {"height_px", i.height_px},
              {"channels", i.channels},
              {"bits", i.bits_per_sample},
              {"exif_orientation", i.exif.orientation},
              {"focal_mm", i.exif.focal_mm},
              {"make", i.exif.make},
              {"model", i.exif.model},
              {"date_time", i.exif.date_time},
              {"decode_scratch_bytes", i.decode_scratch_bytes},
              {"content", i.content.Hex()}};
  if (i.mask)
    out["mask"] = {
        {"name", i.mask->name}, {"content", i.mask->content.Hex()}, {"load_peak_bytes", i.mask->load_peak_bytes}};
  return out;
}

Image ImageFromJson(const json& in, ImageId id) {
  Image i;
  i.id = id;
  i.name = in.at("name");
  i.camera_id = CameraId(in.at("camera").get<std::uint32_t>());
  i.width_px = in.at("width_px");
  i.height_px = in.at("height_px");
  i.channels = in.at("channels");
  i.bits_per_sample = in.at("bits");
  i.exif.orientation = in.at("exif_orientation");
  i.exif.focal_mm = in.at("focal_mm");
  i.exif.make = in.at("make");
  i.exif.model = in.at("model");
  i.exif.date_time = in.at("date_time");
  i.decode_scratch_bytes = in.value("decode_scratch_bytes", std::uint64_t{0});  // of records before it: none
  i.content = DigestFromHex(in.at("content"));
  if (const auto mask = in.find("mask"); mask != in.end())
    i.mask = MaskFile{mask->at("name"), DigestFromHex(mask->at("content")), mask->at("load_peak_bytes")};
  return i;
}

json ToJson(const RunRecord& record, const fs::path& dir) {
  std::error_code failed;
  const fs::path relative = fs::relative(record.images, dir, failed);
  json out = {{"format", "rilievo-workspace"},
              {"version", kWorkspaceVersion},
              {"from_scene", record.from_scene},
              {"processor_level", record.processor_level},
              {"images", (failed || relative.empty() ? record.images : relative).generic_string()},
              {"options", ToJson(record.options)},
              {"warnings", record.warnings},
              {"cameras", json::array()},
              {"image_list", json::array()},
              {"quarantined", json::array()}};
  for (const Camera& camera : record.block.cameras) out["cameras"].push_back(ToJson(camera));
  for (const Image& image : record.block.images) out["image_list"].push_back(ToJson(image));
  for (const auto& q : record.block.quarantined) out["quarantined"].push_back({{"name", q.name}, {"reason", q.reason}});
  return out;
}

RunRecord RecordFromJson(const json& in, const fs::path& dir) {
  RunRecord record;
  const fs::path images = in.at("images").get<std::string>();
  record.images = images.is_absolute() ? images : (dir / images).lexically_normal();
  record.from_scene = in.at("from_scene");
  record.processor_level = in.at("processor_level");
  record.options = OptionsFromJson(in.at("options"));
  record.warnings = in.at("warnings").get<std::vector<std::string>>();
  for (const auto& camera : in.at("cameras"))
    record.block.cameras.push_back(
        CameraFromJson(camera, CameraId(static_cast<std::uint32_t>(record.block.cameras.size()))));
  for (const auto& image : in.at("image_list"))
    record.block.images.push_back(
        ImageFromJson(image, ImageId(static_cast<std::uint32_t>(record.block.images.size()))));
  for (const auto& image : record.block.images)
    if (image.camera_id.value >= record.block.cameras.size())
      throw Error(ErrorCode::kInvalidInput, "", "an image in the record names a camera that is not there");
  for (const ImagePair& pair : record.options.listed)
    if (pair.first >= pair.second || pair.second.value >= record.block.images.size())
      throw Error(ErrorCode::kInvalidInput, "", "a pair in the record names an image that is not there");
  for (const auto& q : in.at("quarantined")) record.block.quarantined.push_back({q.at("name"), q.at("reason")});
  return record;
}

std::string RecordText(const RunRecord& record, const fs::path& dir) {
  // A path that is not UTF-8 is only informative here: its odd bytes are replaced.
  return ToJson(record, dir).dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

std::string ReadText(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw Error(ErrorCode::kUnreadable, path.string(), "cannot be read", "check its permissions");
  return text.str();
}

constexpr const char* kDamagedHint = "remove this file and run orient on this workspace again; finished work is reused";

/// The parsed record; throws one clear Error for anything that is not a record of this version.
json ReadRecordJson(const fs::path& path) {
  json record;
  int version = 0;
  try {
    record = json::parse(ReadText(path));
    if (record.at("format") != "rilievo-workspace")
      throw Error(ErrorCode::kInvalidInput, path.string(), "is not a workspace record");
    version = record.at("version");
  } catch (const json::exception&) {
    throw Error(ErrorCode::kInvalidInput, path.string(), "is damaged", kDamagedHint);
  }
  if (version != kWorkspaceVersion)
    throw Error(ErrorCode::kVersion, path.parent_path().string(),
                "is a workspace of format " + std::to_string(version) + ", this program reads and writes format " +
                    std::to_string(kWorkspaceVersion),
                "use the program that made it, or orient into a new --workspace folder");
  return record;
}

/// The absolute place of a workspace folder, links resolved as far as it exists.
fs::path PlaceOf(const fs::path& dir) {
  if (dir.empty()) throw Error(ErrorCode::kUsage, "--workspace", "is empty", "give a folder");
  return fs::weakly_canonical(fs::absolute(dir));
}

/// Refuses a file, a folder of other things and a workspace of another format.
void RefuseOtherThings(const fs::path& dir) {
  std::error_code failed;
  if (!fs::exists(dir, failed)) return;
  if (!fs::is_directory(dir))
    throw Error(ErrorCode::kInvalidInput, dir.string(), "is a file", "--workspace takes a folder");
  const bool has_record = fs::exists(dir / kRecordName);
  if (!has_record && !fs::exists(dir / kArtifacts) && !fs::is_empty(dir))
    throw Error(ErrorCode::kInvalidInput, dir.string(), "holds other files and is no workspace",
                "give a new or empty folder");
  if (!has_record) return;
  try {
    ReadRecordJson(dir / kRecordName);
  } catch (const Error& error) {
    if (error.code() == ErrorCode::kVersion) throw;  // a damaged record is replaced by the run
  }
}

}  // namespace

Workspace Workspace::OpenOrCreate(const fs::path& dir) {
  const fs::path place = PlaceOf(dir);
  RefuseOtherThings(place);
  Workspace workspace(place, engine::ArtifactStore(place / kArtifacts));
  workspace.RemoveStaleTemporaries();
  return workspace;
}

Workspace Workspace::Open(const fs::path& dir) {
  std::error_code failed;
  if (!fs::is_directory(dir, failed))
    throw Error(ErrorCode::kNotFound, dir.string(), "there is no such workspace folder",
                "give the folder that orient --workspace made");
  if (!fs::exists(dir / kRecordName))
    throw Error(ErrorCode::kNotFound, dir.string(), "is no workspace: it has no run.json",
                "give the folder that orient --workspace made");
  ReadRecordJson(dir / kRecordName);
  const fs::path place = PlaceOf(dir);
  return Workspace(place, engine::ArtifactStore::ForReading(place / kArtifacts));
}

Workspace Workspace::ForPlanning(const fs::path& dir) {
  const fs::path place = PlaceOf(dir);
  RefuseOtherThings(place);
  return Workspace(place, engine::ArtifactStore::ForReading(place / kArtifacts));
}

std::optional<RunRecord> Workspace::ReadRecord() const { return ReadRecordFile(dir_ / kRecordName); }

std::optional<RunRecord> Workspace::ReadRecordFile(const fs::path& path) const {
  if (!fs::exists(path)) return std::nullopt;
  const json record = ReadRecordJson(path);
  try {
    return RecordFromJson(record, dir_);
  } catch (const std::exception& error) {
    throw Error(ErrorCode::kInvalidInput, path.string(), std::string("is damaged: ") + error.what(), kDamagedHint);
  }
}

void Workspace::WriteRecord(const RunRecord& record) const { WriteText(kRecordName, RecordText(record, dir_)); }

void Workspace::BeginRecord(const RunRecord& record) const {
  std::error_code failed;
  const fs::path path = dir_ / kRecordName;
  const std::string text = RecordText(record, dir_);
  if (fs::is_regular_file(path, failed))
    if (const std::string former = ReadText(path); former != text) WriteText(kFormerName, former);
  WriteText(kRecordName, text);
}

std::optional<RunRecord> Workspace::ReadFormerRecord() const {
  try {
    return ReadRecordFile(dir_ / kFormerName);
  } catch (const Error&) {
    return std::nullopt;  // it only saves work
  }
}

void Workspace::DropFormerRecord() const {
  std::error_code ignored;
  fs::remove(dir_ / kFormerName, ignored);
}

void Workspace::WriteText(const std::string& name, const std::string& text) const {
  const fs::path path = dir_ / name;
  std::error_code failed;
  if (fs::is_regular_file(path, failed) && ReadText(path) == text) return;
  engine::WriteFileDurably(path, std::as_bytes(std::span(text)));
}

void Workspace::RemoveStaleTemporaries() const {
  store_.RemoveStaleTemporaries();
  engine::RemoveStaleTemporariesIn(dir_);
}

void Workspace::RemoveReports() const {
  std::error_code ignored;
  for (const char* name : {"report.txt", "report.json"}) fs::remove(dir_ / name, ignored);
}

std::uint64_t FreeDiskBytes(const fs::path& dir) {
  fs::path place = fs::absolute(dir);
  std::error_code failed;
  while (!fs::exists(place, failed) && place.has_parent_path() && place != place.parent_path())
    place = place.parent_path();
  const auto space = fs::space(place, failed);
  return failed ? ~std::uint64_t{0} : space.available;
}

}  // namespace rilievo::scheduling
