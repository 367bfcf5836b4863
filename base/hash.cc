// SHA-256 through OpenSSL's EVP interface; XXH3 through xxhash.
#include "base/hash.h"

#include <openssl/evp.h>
#include <xxhash.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <vector>

#include "base/check.h"
#include "base/error.h"

namespace rilievo {

std::string Sha256Digest::Hex() const {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  text.reserve(64);
  for (const std::uint8_t byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

struct KeyHasher::State {
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  State() { RILIEVO_CHECK(context && EVP_DigestInit_ex(context, EVP_sha256(), nullptr) == 1); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() { EVP_MD_CTX_free(context); }
  void Raw(const void* data, std::size_t size) { RILIEVO_CHECK(EVP_DigestUpdate(context, data, size) == 1); }
};

KeyHasher::KeyHasher() : state_(std::make_unique<State>()) {}
KeyHasher::~KeyHasher() = default;
KeyHasher::KeyHasher(KeyHasher&&) noexcept = default;
KeyHasher& KeyHasher::operator=(KeyHasher&&) noexcept = default;

KeyHasher& KeyHasher::Add(std::string_view text) {
  const std::uint64_t size = text.size();
  state_->Raw(&size, sizeof size);
  state_->Raw(text.data(), text.size());
  return *this;
}

KeyHasher& KeyHasher::Add(std::uint64_t number) {
  return Add(std::string_view(reinterpret_cast<const char*>(&number), sizeof number));
}

KeyHasher& KeyHasher::Add(double number) {
  return Add(std::string_view(reinterpret_cast<const char*>(&number), sizeof number));
}

KeyHasher& KeyHasher::Add(const Sha256Digest& digest) {
  return Add(std::string_view(reinterpret_cast<const char*>(digest.bytes.data()), digest.bytes.size()));
}

Sha256Digest KeyHasher::Finish() {
  Sha256Digest digest;
  unsigned size = 0;
  RILIEVO_CHECK(EVP_DigestFinal_ex(state_->context, digest.bytes.data(), &size) == 1 && size == digest.bytes.size());
  return digest;
}

Sha256Digest HashFile(const std::filesystem::path& path) {
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), &std::fclose);
  if (!file) {
    const int reason = errno;
    throw Error(reason == ENOENT ? ErrorCode::kNotFound : ErrorCode::kUnreadable, path.string(),
                std::string("cannot be opened: ") + std::strerror(reason), "check the path and its permissions");
  }
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  const std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> guard(context, &EVP_MD_CTX_free);
  RILIEVO_CHECK(EVP_DigestInit_ex(context, EVP_sha256(), nullptr) == 1);
  std::vector<char> buffer(std::size_t{1} << 20);
  for (std::size_t n; (n = std::fread(buffer.data(), 1, buffer.size(), file.get())) > 0;)
    RILIEVO_CHECK(EVP_DigestUpdate(context, buffer.data(), n) == 1);
  if (std::ferror(file.get()))
    throw Error(ErrorCode::kUnreadable, path.string(), "cannot be read: " + std::string(std::strerror(errno)),
                "check the disk");
  Sha256Digest digest;
  unsigned size = 0;
  RILIEVO_CHECK(EVP_DigestFinal_ex(context, digest.bytes.data(), &size) == 1);
  return digest;
}

std::uint64_t Checksum(std::span<const std::byte> bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

}  // namespace rilievo
