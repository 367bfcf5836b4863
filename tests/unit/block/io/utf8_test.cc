// Text of unknown origin: well-formed UTF-8 against the code points themselves, and what becomes of the rest.
#include "block/io/utf8.h"

#include <gtest/gtest.h>

#include "base/rng.h"

namespace rilievo::io {
namespace {

/// The definition of UTF-8 without regard to what is well-formed: `bytes` bytes for a code point.
std::string Encode(std::uint32_t code, int bytes) {
  if (bytes == 1) return {static_cast<char>(code)};
  std::string text;
  for (int k = bytes - 1; k > 0; --k)
    text.insert(text.begin(), static_cast<char>(0x80 | (code >> 6 * (bytes - 1 - k) & 63)));
  const unsigned lead = (0xFF00U >> bytes & 0xFFU) | code >> 6 * (bytes - 1);
  return static_cast<char>(lead) + text;
}

TEST(Utf8, TakesEveryScalarValueInItsShortestFormOnly) {
  for (std::uint32_t code = 0; code < 0x120000; ++code) {
    const int least = code < 0x80 ? 1 : code < 0x800 ? 2 : code < 0x10000 ? 3 : 4;
    const bool is_scalar = code <= 0x10FFFF && (code < 0xD800 || code > 0xDFFF);
    for (int bytes = least; bytes <= 4; ++bytes)
      ASSERT_EQ(IsUtf8(Encode(code, bytes)), is_scalar && bytes == least) << code << " in " << bytes;
    const bool is_control = code < 0x20 || (code >= 0x7F && code < 0xA0);
    if (is_scalar) {
      ASSERT_EQ(HasControls(Encode(code, least)), is_control) << code;
    }
  }
}

TEST(Utf8, WhateverComesInWellFormedTextGoesOut) {
  Rng rng(8);
  for (int i = 0; i < 20000; ++i) {
    std::string text;
    for (std::uint32_t k = rng.Below(12); k > 0; --k)
      text += rng.Below(2) == 0 ? "a \xC3\xBC\xE2\x82\xAC\n"[rng.Below(8)] : static_cast<char>(rng.Below(256));
    for (const std::string& out : {CleanText(text), Printable(text)}) {
      ASSERT_TRUE(IsUtf8(out));
      ASSERT_FALSE(HasControls(out));
    }
    if (IsUtf8(text) && !HasControls(text)) {
      ASSERT_EQ(Printable(text), text);
    }
  }
}

TEST(Utf8, Examples) {
  EXPECT_EQ(CleanText(" Z\xC3\xBCrich\x1B[31m \r\n"), "Z\xC3\xBCrich[31m");
  EXPECT_EQ(CleanText("Z\xFCrich"), "Z\xEF\xBF\xBDrich");
  EXPECT_EQ(CleanText("cut \xE2\x82"), "cut \xEF\xBF\xBD\xEF\xBF\xBD");
  EXPECT_EQ(Printable("\xC3\xBC\n\xFC\x1B \xC2\x85"), "\xC3\xBC\\x0a\\xfc\\x1b \\xc2\\x85");
}

}  // namespace
}  // namespace rilievo::io
