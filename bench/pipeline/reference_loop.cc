// The loop that timings of whole runs are divided by: a fixed amount of multiply-adds and of memory traffic, like the
// stages' own mix. Prints its CPU seconds. Compiled for the baseline processor, it does not change with the product.
#include <cstdio>
#include <ctime>
#include <vector>

namespace {

/// Sums of products over arrays in the first-level cache: arithmetic.
float Arithmetic(int rounds) {
  std::vector<float> a(2048, 1.000001F), b(2048, 0.999999F);
  float sums[32] = {};
  for (int round = 0; round < rounds; ++round)
    for (std::size_t i = 0; i < a.size(); i += 32)
      for (std::size_t k = 0; k < 32; ++k) sums[k] = sums[k] * 0.5F + a[i + k] * b[i + k];
  float sum = 0;
  for (const float s : sums) sum += s;
  return sum;
}

/// Strided additions over 64 MiB: memory.
unsigned Memory(int rounds) {
  std::vector<unsigned> cells(std::size_t{16} << 20, 1);
  for (int round = 0; round < rounds; ++round)
    for (std::size_t i = 1; i < cells.size(); ++i) cells[i] += cells[i - 1];
  return cells.back();
}

}  // namespace

int main() {
  const float arithmetic = Arithmetic(60000);
  const unsigned memory = Memory(6);
  const double seconds = static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
  std::fprintf(stderr, "%g %u\n", static_cast<double>(arithmetic), memory);  // or the loops would be left out
  std::printf("%.6f\n", seconds);
}
