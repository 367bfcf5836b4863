// Keeps OpenCV to one thread and quiet.
#include "stages/images/library_setup.h"

#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

namespace rilievo::images {

void PrepareImageLibrary() {
  cv::setNumThreads(1);
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
}

}  // namespace rilievo::images
