// rilievo features: the features of one image, counted, drawn and listed.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <span>
#include <vector>

#include "app/command.h"
#include "app/declared_options.h"
#include "app/run_flags.h"
#include "base/units.h"
#include "block/coverage.h"
#include "block/io/image_header.h"
#include "engine/artifact_store.h"
#include "stages/features/features.h"
#include "stages/images/decode.h"
#include "stages/images/draw_keypoints.h"
#include "stages/images/masks.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kCsvLineBytes = 80, kFeatureBytes = sizeof(Keypoint) + sizeof(Descriptor) + sizeof(Rgb);

struct FeaturesFlags {
  std::string image, mask, draw, output, options_file;
  bool json = false;
  features::Options options;
  RunFlags run;
};

/// What the task finds; written to `output` and `draw` by then.
struct Found {
  std::vector<float> scales_px;  ///< ascending
  double coverage = 0;
  std::optional<double> used_share;  ///< of the pixels, by the mask
  double decode_s = 0, detect_s = 0;
};

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

std::uint64_t Pixels(const Image& image) {
  return static_cast<std::uint64_t>(image.width_px) * static_cast<std::uint64_t>(image.height_px);
}

/// How the image is cut so that its features fit the budget beside its mask.
features::Tiling TilingOf(const FeaturesFlags& flags, const Image& image, std::uint64_t budget_bytes) {
  const std::uint64_t mask_bytes = image.mask ? Pixels(image) : 0;
  return features::ChooseTiling(image.width_px, image.height_px, image.bits_per_sample, flags.options,
                                budget_bytes - std::min(budget_bytes, mask_bytes));
}

TaskCost CostOf(const FeaturesFlags& flags, const Image& image, const PixelSource& source,
                const features::Tiling& tiling) {
  TaskCost cost = features::Estimate(image.width_px, image.height_px, image.bits_per_sample, flags.options, tiling);
  const auto features = static_cast<std::uint64_t>(flags.options.max_features);
  std::uint64_t beside = features * 2 * kCsvLineBytes;
  if (!flags.draw.empty())
    beside = std::max(beside, 5 * Pixels(image) + features * kFeatureBytes +
                                  images::DrawKeypointsBytes(image.width_px, image.height_px));
  cost.peak_bytes = std::max({cost.peak_bytes, source.LoadPeakBytes(image, !flags.draw.empty()), beside});
  if (image.mask) cost.peak_bytes = std::max(cost.peak_bytes + Pixels(image), image.mask->load_peak_bytes);
  return cost;
}

std::string Csv(std::span<const Keypoint> keypoints) {
  std::string text = "x_px,y_px,scale_px,angle_deg,response\n";
  for (const Keypoint& k : keypoints)
    fmt::format_to(std::back_inserter(text), "{},{},{},{},{}\n", k.x_px, k.y_px, k.scale_px,
                   static_cast<float>(RadToDeg(k.angle_rad)), k.response);
  return text;
}

template <class Bytes>
void Write(const std::string& path, const Bytes& bytes) {
  engine::WriteFileDurably(path, std::as_bytes(std::span(bytes)));
}

Found Detect(const FeaturesFlags& flags, const Image& image, const PixelSource& source, const features::Tiling& tiling,
             RunContext& context) {
  Found found;
  const auto start = std::chrono::steady_clock::now();
  std::vector<std::uint8_t> mask;
  if (image.mask) {
    mask = images::LoadMask(images::FolderPixelSource(fs::path(flags.mask).parent_path()), *image.mask, image);
    const auto used = std::count_if(mask.begin(), mask.end(), [](std::uint8_t value) { return value >= 128; });
    found.used_share = static_cast<double>(used) / static_cast<double>(mask.size());
  }
  const GreyImage pixels = source.Load(image.name, !flags.draw.empty());
  found.decode_s = SecondsSince(start);
  context.ReportProgress(0.1);
  const auto decoded = std::chrono::steady_clock::now();
  const ImageFeatures features = features::Run({pixels, mask, tiling}, flags.options, context);
  found.detect_s = SecondsSince(decoded);
  for (const Keypoint& k : features.keypoints) found.scales_px.push_back(k.scale_px);
  std::sort(found.scales_px.begin(), found.scales_px.end());
  found.coverage = Coverage(features.keypoints, image.width_px, image.height_px);
  if (!flags.output.empty()) Write(flags.output, Csv(features.keypoints));
  if (!flags.draw.empty()) Write(flags.draw, images::DrawKeypoints(pixels, features.keypoints));
  return found;
}

nlohmann::json ToJson(const FeaturesFlags& flags, const Image& image, const Found& found) {
  nlohmann::json out = {{"format", "rilievo-features"},  {"version", 1},
                        {"image", flags.image},          {"width_px", image.width_px},
                        {"height_px", image.height_px},  {"channels", image.channels},
                        {"bits", image.bits_per_sample}, {"features", found.scales_px.size()},
                        {"coverage", found.coverage},    {"decode_s", found.decode_s},
                        {"detect_s", found.detect_s}};
  if (found.used_share) out["used_share"] = *found.used_share;
  if (const auto& s = found.scales_px; !s.empty())
    out["scale_px"] = {{"min", s.front()}, {"median", s[s.size() / 2]}, {"max", s.back()}};
  return out;
}

void PrintText(const FeaturesFlags& flags, const Image& image, const Found& found) {
  const double megapixels = 1e-6 * static_cast<double>(Pixels(image));
  fmt::print("image     {}: {} x {} px, {} channel{} of {} bits\n", flags.image, image.width_px, image.height_px,
             image.channels, image.channels == 1 ? "" : "s", image.bits_per_sample);
  if (found.used_share)
    fmt::print("mask      {}: {:.1f} % of the pixels are used\n", flags.mask, 100 * *found.used_share);
  fmt::print("features  {} ({:.0f} a megapixel), coverage {:.1f} % of 8 x 8 cells\n", found.scales_px.size(),
             static_cast<double>(found.scales_px.size()) / megapixels, 100 * found.coverage);
  if (const auto& s = found.scales_px; !s.empty())
    fmt::print("scale     {:.2f} / {:.2f} / {:.1f} px (least / median / largest)\n", s.front(), s[s.size() / 2],
               s.back());
  fmt::print("time      {} to decode, {} to detect and describe\n", FormatDuration(found.decode_s),
             FormatDuration(found.detect_s));
}

Image Inspect(const FeaturesFlags& flags) {
  const auto split = [](const std::string& path, const char* what) {
    if (fs::path(path).filename().empty())
      throw Error(ErrorCode::kUsage, what, "'" + path + "' is no file", "give an image file");
    return std::pair{fs::path(path).parent_path(), fs::path(path).filename().string()};
  };
  const auto [folder, name] = split(flags.image, "IMAGE");
  Image image = io::ReadImageHeader(folder, name);
  if (!flags.mask.empty()) {
    const auto [mask_folder, mask_name] = split(flags.mask, "--mask");
    image.mask = images::InspectMask(mask_folder, mask_name, image);
  }
  return image;
}

int RunFeatures(const FeaturesFlags& flags, ProgramContext& context) {
  ValidateOptions(flags.options, features::OptionDeclarations());
  const PlanRunner runner(flags.run, context);
  const Image image = Inspect(flags);
  const images::FolderPixelSource source(fs::path(flags.image).parent_path());
  Found found;
  engine::Plan plan;
  const features::Tiling tiling = TilingOf(flags, image, runner.limits().budget_bytes);
  const TaskCost cost = CostOf(flags, image, source, tiling);
  plan.Add({.name = "features " + image.name,
            .stage = "features",
            .needs = {},
            .cost = cost,
            .memory_hint = fmt::format("use --memory {}MiB or more, or a smaller image",
                                       (cost.peak_bytes + runner.overhead_bytes()) / kMebibyte + 1),
            .run = [&](engine::TaskContext& task) { found = Detect(flags, image, source, tiling, task); }});
  runner.Run(plan);
  if (flags.json)
    fmt::print("{}\n", ToJson(flags, image, found).dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
  else if (!flags.run.quiet)
    PrintText(flags, image, found);
  return kExitDone;
}

}  // namespace

void AddFeaturesCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<FeaturesFlags>();
  CLI::App* command = app.add_subcommand("features", "Features of one image: count, coverage, list, drawing");
  command->add_option("image", flags->image, "Photograph (JPEG, PNG, TIFF)")->required()->type_name("IMAGE");
  command
      ->add_option("--mask", flags->mask,
                   "8-bit image of the same size: features are kept where it is bright (128 and more)")
      ->type_name("FILE");
  command
      ->add_option("--draw", flags->draw,
                   "Draw the features over the image: circles of three times the scale, a tick in their direction, "
                   "coloured by octave; above 25 Mpx reduced")
      ->type_name("OUT.png");
  command->add_option("--output", flags->output, "List the features as CSV (docs/formats/features_csv.md)")
      ->type_name("OUT.csv");
  command->add_flag("--json", flags->json, "Print the summary as JSON for programs");
  AddOptionsFile(*command, flags->options_file);
  AddDeclaredOptions(*command, flags->options, features::OptionDeclarations(), "Features");
  AddRunFlags(*command, flags->run);
  command->footer("Example:\n  rilievo features photos/IMG_0001.JPG --draw features.png --output features.csv");
  command->callback([flags, command, &context] {
    ApplyOptionsFile(*command, flags->options_file);
    context.exit_code = RunFeatures(*flags, context);
  });
}

}  // namespace rilievo::app
