// Lines of a pair list: two names between tabs, quotes or blanks.
#include "block/io/pair_list.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "base/error.h"
#include "block/io/image_names.h"
#include "block/io/text.h"
#include "block/io/utf8.h"

namespace rilievo::io {
namespace {

/// The names of a line: between tabs where there is one, else between blanks; a name in double quotes is whole. None
/// for a quote that is not closed.
std::optional<std::vector<std::string>> NamesOf(std::string_view line) {
  const std::string_view separators = line.find('\t') != std::string_view::npos ? "\t" : " ";
  std::vector<std::string> names;
  for (line = Trim(line); !line.empty(); line = Trim(line)) {
    if (separators.find(line.front()) != std::string_view::npos) {
      line.remove_prefix(1);
      continue;
    }
    const bool quoted = line.front() == '"';
    if (quoted) line.remove_prefix(1);
    const std::size_t end = line.find_first_of(quoted ? "\"" : separators);
    if (quoted && end == std::string_view::npos) return std::nullopt;
    const std::string_view name = line.substr(0, end);
    names.emplace_back(quoted ? name : Trim(name));
    line.remove_prefix(std::min(line.size(), name.size() + (quoted ? 1 : 0)));
  }
  return names;
}

class PairListReader {
 public:
  PairListReader(const std::filesystem::path& path, const Block& block)
      : path_(path), usable_(block.images.size()), names_(AllNames(block)), known_(names_) {}

  PairList Read() {
    const std::string content = ReadWholeFile(path_, std::size_t{1} << 28);
    PairList list;
    for (const TextLine& line : SplitLines(content)) {
      if (line.text.empty() || line.text.starts_with('#')) continue;
      if (const auto pair = ReadLine(line))
        list.pairs.push_back(*pair);
      else
        ++list.left_out;
    }
    std::sort(list.pairs.begin(), list.pairs.end());
    list.pairs.erase(std::unique(list.pairs.begin(), list.pairs.end()), list.pairs.end());
    if (list.pairs.empty())
      throw Error(ErrorCode::kInvalidInput, path_.string(), "names no pair of usable images",
                  "write two image names a line");
    return list;
  }

 private:
  /// The images of the block by id, then the files that are there and cannot be used.
  static std::vector<std::string> AllNames(const Block& block) {
    std::vector<std::string> names;
    for (const Image& image : block.images) names.push_back(image.name);
    for (const auto& quarantined : block.quarantined) names.push_back(quarantined.name);
    return names;
  }

  Error Bad(const TextLine& line, const std::string& message, const std::string& hint) const {
    return {ErrorCode::kInvalidInput, path_.string(), "line " + std::to_string(line.number) + ": " + message, hint};
  }

  std::size_t Find(const TextLine& line, const std::string& name) const {
    const auto found = known_.Find(name);
    if (found.empty())
      throw Bad(line, "'" + Printable(name) + "' is none of the images",
                "write names as in the image folder, those with blanks in double quotes or between tabs");
    if (found.size() > 1)
      throw Bad(line, "'" + Printable(name) + "' may be " + names_[found[0]] + " or " + names_[found[1]],
                "write the name with its folder");
    return found.front();
  }

  /// None where one of the two is not usable.
  std::optional<ImagePair> ReadLine(const TextLine& line) const {
    const auto names = NamesOf(line.text);
    if (!names)
      throw Bad(line, "a double quote is not closed", "write each name with blanks between two double quotes");
    if (names->size() != 2)
      throw Bad(line, "holds " + std::to_string(names->size()) + " names, a pair has two",
                "put names with blanks in double quotes, or a tab between the two");
    const std::size_t a = Find(line, names->front()), b = Find(line, names->back());
    if (a == b) throw Bad(line, "'" + names_[a] + "' is paired with itself", "write two different images");
    if (std::max(a, b) >= usable_) return std::nullopt;
    return ImagePair{ImageId(static_cast<std::uint32_t>(std::min(a, b))),
                     ImageId(static_cast<std::uint32_t>(std::max(a, b)))};
  }

  const std::filesystem::path& path_;
  std::size_t usable_;
  std::vector<std::string> names_;
  ImageNames known_;
};

}  // namespace

PairList ReadPairList(const std::filesystem::path& path, const Block& block) {
  return PairListReader(path, block).Read();
}

}  // namespace rilievo::io
