// The sub-commands of features_eval; each gives the JSON that it prints. All throw Error.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace rilievo::bench {

using Json = nlohmann::ordered_json;

/// CPU seconds of the stage's detectors and OpenCV's on one image, one thread.
Json MeasureSpeed(const std::string& image_path, int repeats);
/// Throughput of two threads over one's on these images, beside a pure FMA loop's.
Json MeasureScaling(const std::vector<std::string>& image_paths, int rounds);
/// Repeatability and matching score on a folder img1, H1to2p, ... of the Oxford kind.
Json MeasureRepeatability(const std::string& folder);
/// Epipolar errors of matched features in rendered blocks with exact truth.
Json MeasureLocalisation();
/// Hashes of the features by tile width and number of threads; the first variant's features go to `dump_path`.
Json MeasureIdentity(const std::string& image_path, const std::string& dump_path);
/// Correct matches of each descriptor on such folders and in rendered blocks; variance that the projections keep.
Json MeasureDescriptors(const std::vector<std::string>& folders);
/// Learns the projections of GLOH and PCA-SIFT and writes their source files into `folder`. About a minute.
Json LearnProjections(const std::string& folder);
/// Share of features that two dumps of MeasureIdentity do not have in common.
Json CompareDumps(const std::string& first_path, const std::string& second_path);

}  // namespace rilievo::bench
