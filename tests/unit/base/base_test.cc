// The few words that everything shares.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <span>

#include "base/hash.h"
#include "base/option.h"
#include "base/rng.h"
#include "base/serialize.h"
#include "base/units.h"

namespace rilievo {
namespace {

TEST(Units, BytesAsPeopleWriteThem) {
  EXPECT_EQ(ParseBytes("4GiB"), 4 * kGibibyte);
  EXPECT_EQ(ParseBytes("1.5 GiB"), 3 * kGibibyte / 2);
  EXPECT_EQ(ParseBytes("800mb"), 800'000'000u);
  EXPECT_EQ(ParseBytes("4096"), 4096u);
  for (const char* bad : {"", "GiB", "-1GiB", "0", "4 pounds", "nan", "inf", "1e400"})
    EXPECT_THROW(ParseBytes(bad), Error) << bad;
  EXPECT_EQ(FormatBytes(4 * kGibibyte), "4.0 GiB");
  EXPECT_EQ(ParseBytes(FormatBytes(512 * kMebibyte)), 512 * kMebibyte);
}

TEST(Hash, KnownDigestOfAFile) {
  const auto path = std::filesystem::temp_directory_path() / "rilievo-hash-test";
  std::ofstream(path) << "abc";  // FIPS 180-2, appendix B.1
  EXPECT_EQ(HashFile(path).Hex(), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  std::filesystem::remove(path);
  EXPECT_THROW(HashFile(path), Error);
}

TEST(Hash, PartsDoNotRunTogether) {
  const auto of = [](std::string_view a, std::string_view b) { return KeyHasher().Add(a).Add(b).Finish(); };
  EXPECT_NE(of("ab", "c"), of("a", "bc"));
  EXPECT_EQ(of("ab", "c"), of("ab", "c"));
}

TEST(Rng, UniformIntegersFillTheirRangeEvenly) {
  Rng rng(SeedFor(1, 2, 3));
  std::array<int, 10> counts{};
  for (int i = 0; i < 100000; ++i) ++counts[rng.Below(10)];
  double chi_square = 0;
  for (const int count : counts) chi_square += (count - 10000.0) * (count - 10000.0) / 10000.0;
  EXPECT_LT(chi_square, 27.9);  // 9 degrees of freedom, 0.1 %
}

TEST(Rng, SeedsDependOnEveryIdAndTheirOrder) {
  EXPECT_NE(SeedFor(0, 1, 2), SeedFor(0, 2, 1));
  EXPECT_NE(SeedFor(0, 1, 2), SeedFor(1, 1, 2));
}

TEST(Serialize, ComesBackAndNeverReadsPastTheEnd) {
  ByteWriter writer;
  writer.Put<std::uint16_t>(7);
  writer.PutString("äb");
  writer.PutVector(std::vector<double>{1.5, -0.0});
  const auto bytes = writer.Take();
  ByteReader reader(bytes);
  EXPECT_EQ(reader.Get<std::uint16_t>(), 7);
  EXPECT_EQ(reader.GetString(), "äb");
  EXPECT_EQ(reader.GetVector<double>(), (std::vector<double>{1.5, -0.0}));
  EXPECT_TRUE(reader.AtEnd());
  for (std::size_t cut = 0; cut < bytes.size(); ++cut) {
    ByteReader shorter{std::span<const std::byte>(bytes).first(cut)};
    EXPECT_THROW((shorter.Get<std::uint16_t>(), shorter.GetString(), shorter.GetVector<double>()), Error) << cut;
  }
}

struct SampleOptions {
  bool flag = true;
  int count = 3;
  double size = 0.5;
  std::string kind = "a";
};

// Every field is given: g++ 12 fails inside on the default of `choices` in nested braces.
std::vector<OptionDeclaration<SampleOptions>> Declarations() {
  using D = OptionDeclaration<SampleOptions>;
  return {D{"flag", &SampleOptions::flag, 0, 0, "", "", {}}, D{"count", &SampleOptions::count, 1, 9, "", "", {}},
          D{"size", &SampleOptions::size, 0, 1, "", "", {}}, D{"kind", &SampleOptions::kind, 0, 0, "", "", {"a", "b"}}};
}

TEST(Options, TextComesBackExactly) {
  const auto declarations = Declarations();
  SampleOptions options{false, 7, 0.1 + 0.2, "b"}, read;
  for (const auto& d : declarations) SetOptionValue(read, d, OptionValueText(options, d));
  const std::span<const OptionDeclaration<SampleOptions>> all(declarations);
  EXPECT_EQ(OptionKeyText(read, all), OptionKeyText(options, all));
  EXPECT_EQ(read.size, 0.1 + 0.2);
}

TEST(Options, OutOfRangeIsNamed) {
  const auto declarations = Declarations();
  const std::span<const OptionDeclaration<SampleOptions>> all(declarations);
  EXPECT_NO_THROW(ValidateOptions(SampleOptions{}, all));
  EXPECT_THROW(ValidateOptions(SampleOptions{.count = 10}, all), Error);
  EXPECT_THROW(ValidateOptions(SampleOptions{.size = std::nan("")}, all), Error);
  EXPECT_THROW(ValidateOptions(SampleOptions{.kind = "c"}, all), Error);
  SampleOptions options;
  EXPECT_THROW(SetOptionValue(options, declarations[1], "3.5"), Error);
  EXPECT_THROW(SetOptionValue(options, declarations[0], "yes"), Error);
}

}  // namespace
}  // namespace rilievo
