// Block types from the command line, and pairs that come from outside.
#include "app/pair_inputs.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <utility>
#include <vector>

#include "block/io/pair_list.h"
#include "scheduling/spatial_pairs.h"

namespace rilievo::app {
namespace {

using scheduling::Network;

std::vector<ImagePair> PairsOfList(const PairFlags& flags, Inputs& inputs) {
  io::PairList list = io::ReadPairList(flags.list, inputs.block);
  if (list.left_out > 0)
    inputs.warnings.push_back(
        fmt::format("{} pairs of {} name an image that cannot be used and are left out", list.left_out, flags.list));
  return std::move(list.pairs);
}

std::vector<ImagePair> PairsByPosition(const scheduling::PairOptions& options, Inputs& inputs) {
  const auto positions = scheduling::ImagePositions(inputs.block);
  const auto missing = std::count(positions.begin(), positions.end(), std::nullopt);
  if (missing == static_cast<std::ptrdiff_t>(positions.size()))
    throw Error(ErrorCode::kInvalidInput, inputs.images.string(),
                "no image has a GNSS position in EXIF, which --network spatial chooses pairs by",
                "use --network guided or sparse");
  if (missing > 0)
    inputs.warnings.push_back(fmt::format(
        "{} of {} images have no GNSS position in EXIF and are paired with every image", missing, positions.size()));
  auto pairs = scheduling::SpatialPairs(positions, {options.neighbours, options.max_distance_m});
  if (pairs.empty())
    throw Error(ErrorCode::kInvalidInput, inputs.images.string(),
                fmt::format("no two images were taken within {} m of each other", options.max_distance_m),
                "raise --max-distance-m");
  return pairs;
}

}  // namespace

void AddPairFlags(CLI::App& command, PairFlags& flags) {
  command
      .add_option("--network", flags.network,
                  "Which pairs are matched. sparse: all n(n-1)/2; sequence: the 2n-3 of successive triplets; guided: "
                  "those that few large features and then verified neighbours speak for; spatial: images taken near "
                  "each other (GNSS in EXIF); list: those of --pairs")
      ->check(CLI::IsMember({"sparse", "sequence", "guided", "spatial", "list"}))
      ->capture_default_str();
  command
      .add_option("--pairs", flags.list,
                  "With --network list: text file of the pairs, two image names a line (docs/formats/pairs.md)")
      ->type_name("FILE");
}

Network NetworkOf(const PairFlags& flags) {
  const Network network = *scheduling::NetworkFromName(flags.network);
  if (network == Network::kList && flags.list.empty())
    throw Error(ErrorCode::kUsage, "--network list", "needs the pairs", "give a file with --pairs");
  if (network != Network::kList && !flags.list.empty())
    throw Error(ErrorCode::kUsage, "--pairs", "does not go with --network " + flags.network, "use --network list");
  return network;
}

void ListPairs(const PairFlags& flags, Inputs& inputs, scheduling::OrientOptions& options) {
  if (options.network == Network::kList) options.listed = PairsOfList(flags, inputs);
  if (options.network == Network::kSpatial) options.listed = PairsByPosition(options.pairs, inputs);
}

}  // namespace rilievo::app
