// Text of unknown origin (file names, EXIF) made fit for reports and exports, which are UTF-8 and go line by line.
#include "block/io/utf8.h"

#include "block/io/text.h"

namespace rilievo::io {
namespace {

/// Bytes of the character at the front of `text`; 0 when they are not well-formed. Table 3-7 of the Unicode standard.
std::size_t CharacterBytes(std::string_view text) {
  const auto byte = [&](std::size_t k) { return k < text.size() ? static_cast<unsigned char>(text[k]) : 0U; };
  const unsigned lead = byte(0), second = byte(1);
  const std::size_t count = lead < 0x80                   ? 1
                            : lead >= 0xC2 && lead < 0xE0 ? 2
                            : lead >= 0xE0 && lead < 0xF0 ? 3
                            : lead >= 0xF0 && lead < 0xF5 ? 4
                                                          : 0;
  for (std::size_t k = 1; k < count; ++k)
    if ((byte(k) & 0xC0U) != 0x80U) return 0;
  if ((lead == 0xE0 && second < 0xA0) || (lead == 0xED && second > 0x9F)) return 0;
  if ((lead == 0xF0 && second < 0x90) || (lead == 0xF4 && second > 0x8F)) return 0;
  return count;
}

/// `character` as one of CharacterBytes: C0 and DEL are one byte, C1 is U+0080 to U+009F.
bool IsControl(std::string_view character) {
  const auto lead = static_cast<unsigned char>(character[0]);
  if (character.size() == 1) return lead < 0x20 || lead == 0x7F;
  return lead == 0xC2 && static_cast<unsigned char>(character[1]) < 0xA0;
}

/// Calls visit(bytes, is_well_formed) for the characters in order; a malformed byte comes alone.
template <class Visit>
void ForEachCharacter(std::string_view text, Visit visit) {
  while (!text.empty()) {
    const std::size_t count = CharacterBytes(text), step = count == 0 ? 1 : count;
    visit(text.substr(0, step), count != 0);
    text.remove_prefix(step);
  }
}

}  // namespace

bool IsUtf8(std::string_view text) {
  bool all = true;
  ForEachCharacter(text, [&](std::string_view, bool is_well_formed) { all = all && is_well_formed; });
  return all;
}

bool HasControls(std::string_view text) {
  bool any = false;
  ForEachCharacter(text,
                   [&](std::string_view c, bool is_well_formed) { any = any || (is_well_formed && IsControl(c)); });
  return any;
}

std::string CleanText(std::string_view text) {
  std::string clean;
  ForEachCharacter(text, [&](std::string_view c, bool is_well_formed) {
    if (!is_well_formed)
      clean += "\xEF\xBF\xBD";
    else if (!IsControl(c))
      clean += c;
  });
  return std::string(Trim(clean));
}

std::string Printable(std::string_view text) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string printable;
  ForEachCharacter(text, [&](std::string_view c, bool is_well_formed) {
    if (is_well_formed && !IsControl(c)) {
      printable += c;
      return;
    }
    for (const char byte : c) {
      const auto value = static_cast<unsigned char>(byte);
      printable += std::string("\\x") + kDigits[value >> 4] + kDigits[value & 15];
    }
  });
  return printable;
}

}  // namespace rilievo::io
