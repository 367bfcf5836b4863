// Finds the photographs of a folder and puts them in order.
#include "block/io/image_folder.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <set>
#include <system_error>
#include <utility>

#include "base/error.h"
#include "block/io/image_names.h"
#include "block/io/text.h"
#include "block/io/utf8.h"

namespace rilievo::io {
namespace fs = std::filesystem;
namespace {

constexpr std::array<std::string_view, 5> kImageExtensions{".jpg", ".jpeg", ".png", ".tif", ".tiff"};
constexpr std::array<std::string_view, 20> kOtherPhotoExtensions{
    ".bmp", ".webp", ".heic", ".heif", ".avif", ".jp2", ".jxl", ".gif", ".exr", ".ppm",
    ".pgm", ".dng",  ".cr2",  ".cr3",  ".nef",  ".arw", ".raf", ".orf", ".rw2", ".pef"};

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

std::string LowerExtension(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

template <std::size_t N>
bool Contains(const std::array<std::string_view, N>& list, std::string_view text) {
  return std::find(list.begin(), list.end(), text) != list.end();
}

void AddFile(const fs::directory_entry& entry, const std::string& name, FoundImages& found) {
  const std::string extension = LowerExtension(entry.path());
  const bool is_image = Contains(kImageExtensions, extension), is_other = Contains(kOtherPhotoExtensions, extension);
  if (!is_image && !is_other) return;
  std::error_code ec;
  const fs::file_status status = entry.status(ec);
  if (ec || status.type() == fs::file_type::not_found) {
    found.ignored.push_back({Printable(name), "link to a file that does not exist"});
  } else if (fs::is_regular_file(status)) {
    if (is_other)
      found.ignored.push_back(
          {Printable(name), "format " + extension.substr(1) + " is not read; convert it to JPEG, PNG or TIFF"});
    else if (!IsUtf8(name))
      found.ignored.push_back({Printable(name), "file name is not UTF-8; rename the file"});
    else if (HasControls(name))
      found.ignored.push_back({Printable(name), "file or folder name has control characters; rename it"});
    else
      found.names.push_back(name);
  }
}

std::string Unreadable(const std::error_code& ec) { return "cannot be read: " + ec.message(); }

/// A folder still to be searched; `name` is relative to the image folder, empty for itself.
struct OpenFolder {
  fs::path path;
  std::string name;
};

/// Sorts the entries of one folder into `found`; its subfolders go to `open`. Returns why reading it ended early.
std::error_code SearchFolder(const OpenFolder& folder, FoundImages& found, std::vector<OpenFolder>& open) {
  std::error_code ec;
  fs::directory_iterator walk(folder.path, ec);
  for (const fs::directory_iterator end; !ec && walk != end; walk.increment(ec)) {
    const std::string base_name = walk->path().filename().string();
    if (base_name.starts_with('.')) continue;
    const std::string name = folder.name.empty() ? base_name : folder.name + "/" + base_name;
    std::error_code status_ec;  // an entry that cannot be looked at is AddFile's matter
    if (!walk->is_directory(status_ec))
      AddFile(*walk, name, found);
    else if (walk->is_symlink(status_ec))
      found.ignored.push_back(
          {Printable(name), "link to a folder is not followed; put the folder itself, or links to its files, here"});
    else
      open.push_back({walk->path(), name});
  }
  return ec;
}

}  // namespace

bool NaturalLess(std::string_view a, std::string_view b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (IsDigit(a[i]) && IsDigit(b[j])) {
      const auto number = [](std::string_view text, std::size_t& at) {
        std::size_t end = at;
        while (end < text.size() && IsDigit(text[end])) ++end;
        std::size_t begin = at;
        while (begin + 1 < end && text[begin] == '0') ++begin;
        at = end;
        return text.substr(begin, end - begin);
      };
      const std::string_view x = number(a, i), y = number(b, j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
    } else {
      if (a[i] != b[j]) return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
      ++i, ++j;
    }
  }
  const std::size_t rest_a = a.size() - i, rest_b = b.size() - j;
  if (rest_a == 0 && rest_b == 0) return a < b;
  return rest_a == 0;
}

FoundImages FindImages(const fs::path& folder) {
  std::error_code ec;
  const fs::file_status status = fs::status(folder, ec);
  if (status.type() == fs::file_type::not_found)
    throw Error(ErrorCode::kNotFound, folder.string(), "image folder does not exist", "check the path");
  if (status.type() == fs::file_type::none)
    throw Error(ErrorCode::kUnreadable, folder.string(), Unreadable(ec), "check its permissions");
  if (!fs::is_directory(status))
    throw Error(ErrorCode::kInvalidInput, folder.string(), "is not a folder", "name the folder that holds the images");

  FoundImages found;
  std::vector<OpenFolder> open{{folder, ""}};
  while (!open.empty()) {
    const OpenFolder next = std::move(open.back());
    open.pop_back();
    ec = SearchFolder(next, found, open);
    if (!ec) continue;
    if (next.name.empty())
      throw Error(ErrorCode::kUnreadable, folder.string(), Unreadable(ec), "check its permissions");
    found.ignored.push_back({Printable(next.name), "folder " + Unreadable(ec)});
  }
  std::sort(found.names.begin(), found.names.end(), NaturalLess);
  std::sort(found.ignored.begin(), found.ignored.end(),
            [](const auto& a, const auto& b) { return NaturalLess(a.name, b.name); });
  if (found.names.empty()) {
    const std::string why =
        found.ignored.empty() ? "" : "; " + found.ignored.front().name + ": " + found.ignored.front().reason;
    throw Error(ErrorCode::kInvalidInput, folder.string(), "no image found" + why,
                "images are .jpg .jpeg .png .tif .tiff files");
  }
  return found;
}

std::vector<std::string> ReadOrderFile(const fs::path& path, std::span<const std::string> names) {
  const std::string content = ReadWholeFile(path, std::size_t{1} << 26);
  const ImageNames known(names);

  std::vector<std::string> order;
  std::map<std::string, std::size_t> line_of;
  bool first = true;
  for (const TextLine& line : SplitLines(content)) {
    if (line.text.empty() || line.text.starts_with('#')) continue;
    const auto bad = [&](const std::string& message, const std::string& hint) {
      return Error(ErrorCode::kInvalidInput, path.string(), "line " + std::to_string(line.number) + ": " + message,
                   hint);
    };
    const bool may_be_count = std::exchange(first, false);
    const std::vector<std::size_t> found = known.Find(line.text);
    if (found.empty()) {
      if (may_be_count && std::all_of(line.text.begin(), line.text.end(), IsDigit)) continue;
      throw bad("'" + Printable(line.text) + "' is none of the images",
                "write one image name a line, as in the image folder");
    }
    if (found.size() > 1)
      throw bad("'" + Printable(line.text) + "' may be " + names[found[0]] + " or " + names[found[1]],
                "write the name with its folder");
    std::string name = names[found.front()];
    const auto [previous, is_new] = line_of.emplace(name, line.number);
    if (!is_new)
      throw bad("'" + name + "' was already on line " + std::to_string(previous->second), "name each image once");
    order.push_back(std::move(name));
  }
  if (order.empty())
    throw Error(ErrorCode::kInvalidInput, path.string(), "names no image", "write one image name a line");
  return order;
}

std::vector<QuarantinedImage> LeftOutByOrder(std::span<const std::string> names, std::span<const std::string> order) {
  const std::set<std::string_view> listed(order.begin(), order.end());
  std::vector<QuarantinedImage> left_out;
  for (const auto& name : names)
    if (!listed.contains(name)) left_out.push_back({name, "not in the order file"});
  std::sort(left_out.begin(), left_out.end(), [](const auto& a, const auto& b) { return NaturalLess(a.name, b.name); });
  return left_out;
}

}  // namespace rilievo::io
