// Words for the reasons of rejection.
#include "block/pair.h"

namespace rilievo {

std::string ToText(RejectionReason reason) {
  switch (reason) {
    case RejectionReason::kNone:
      return "verified";
    case RejectionReason::kTooFewMatches:
      return "too few matches";
    case RejectionReason::kTooFewInliers:
      return "too few matches agree with one geometry";
    case RejectionReason::kNoModel:
      return "no geometry found";
  }
  return "";
}

}  // namespace rilievo
