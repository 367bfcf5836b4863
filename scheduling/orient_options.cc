// Validation of all groups by their declarations.
#include "scheduling/orient_options.h"

namespace rilievo::scheduling {

void Validate(const OrientOptions& options) {
  ValidateOptions(options.pairs, PairOptionDeclarations());
  ValidateOptions(options.features, features::OptionDeclarations());
  ValidateOptions(options.matching, matching::OptionDeclarations());
  ValidateOptions(options.verification, verification::OptionDeclarations());
  ValidateOptions(options.mapping, mapping::OptionDeclarations());
}

}  // namespace rilievo::scheduling
