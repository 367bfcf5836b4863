// Validation of all groups by their declarations.
#include "scheduling/orient_options.h"

namespace rilievo::scheduling {

void Validate(const OrientOptions& options) {
  ValidateOptions(options.pairs, PairOptionDeclarations());
  ValidateOptions(options.features, features::OptionDeclarations());
  ValidateOptions(options.matching, matching::OptionDeclarations());
  ValidateOptions(options.verification, verification::OptionDeclarations());
  ValidateOptions(options.tracks, tracks::OptionDeclarations());
  if (options.tracks.closed_sequence && options.network != Network::kSequence)
    throw Error(ErrorCode::kUsage, "--closed-sequence", "only an ordered sequence can be closed",
                "add --network sequence");
  ValidateOptions(options.mapping, mapping::OptionDeclarations());
}

}  // namespace rilievo::scheduling
