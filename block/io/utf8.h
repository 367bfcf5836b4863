// Text of unknown origin (file names, EXIF) made fit for reports and exports, which are UTF-8 and go line by line.
#pragma once

#include <string>
#include <string_view>

namespace rilievo::io {

/// Well-formed by table 3-7 of the Unicode standard.
bool IsUtf8(std::string_view text);

/// Whether well-formed UTF-8 holds a control character (C0, DEL or C1): a line end, or what a terminal would obey.
bool HasControls(std::string_view text);

/// For use as data: every byte outside well-formed UTF-8 becomes U+FFFD, control characters and blanks at both ends are
/// dropped.
std::string CleanText(std::string_view text);

/// For messages: every byte outside well-formed UTF-8 and of control characters becomes \xNN.
std::string Printable(std::string_view text);

}  // namespace rilievo::io
