// Names of the block types, declarations of the options.
#include "scheduling/pair_options.h"

#include <array>
#include <utility>
#include <vector>

namespace rilievo::scheduling {
namespace {

constexpr std::array<std::pair<Network, std::string_view>, 5> kNames{{{Network::kSparse, "sparse"},
                                                                      {Network::kSequence, "sequence"},
                                                                      {Network::kGuided, "guided"},
                                                                      {Network::kSpatial, "spatial"},
                                                                      {Network::kList, "list"}}};

}  // namespace

std::string_view NetworkName(Network network) {
  for (const auto& [value, name] : kNames)
    if (value == network) return name;
  return "";
}

std::optional<Network> NetworkFromName(std::string_view name) {
  for (const auto& [value, text] : kNames)
    if (text == name) return value;
  return std::nullopt;
}

std::span<const OptionDeclaration<PairOptions>> PairOptionDeclarations() {
  static const std::vector<OptionDeclaration<PairOptions>> declarations = {
      {"neighbours",
       &PairOptions::neighbours,
       0,
       100000,
       "",
       "spatial: pairs of an image with its nearest so many others; 0 = no limit",
       {}},
      {"max-distance-m",
       &PairOptions::max_distance_m,
       0,
       1e7,
       "m",
       "spatial: no pair of images taken farther apart; 0 = no limit",
       {}},
      {"guided-features",
       &PairOptions::guided_features,
       64,
       8192,
       "",
       "guided: largest features of an image that the fast pass compares",
       {}},
  };
  return declarations;
}

}  // namespace rilievo::scheduling
