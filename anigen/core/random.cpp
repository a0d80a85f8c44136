#include "anigen/core/random.h"

#include <cmath>
#include <numeric>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen {

namespace {

constexpr std::uint64_t kGamma = 0x9E3779B97F4A7C15ull;

__extension__ using Wide = unsigned __int128;

std::uint64_t mix(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return z ^ (z >> 31);
}

}  // namespace

std::uint64_t stable_hash(std::string_view bytes, std::uint64_t seed) {
  std::uint64_t h = 0xCBF29CE484222325ull ^ mix(seed + kGamma);
  for (unsigned char c : bytes) h = (h ^ c) * 0x100000001B3ull;
  return mix(h);
}

Rng::Rng(std::uint64_t seed, std::string_view purpose, std::uint64_t index)
    : key_(mix(stable_hash(purpose, seed) + mix(index + kGamma))) {}

Rng Rng::from_state(std::array<std::uint64_t, 2> state) {
  Rng rng;
  rng.key_ = state[0];
  rng.counter_ = state[1];
  return rng;
}

std::uint64_t Rng::next() { return mix(key_ + kGamma * ++counter_); }

double Rng::uniform() { return static_cast<double>(next() >> 11) * 0x1.0p-53; }

double Rng::uniform(double low, double high) { return low + (high - low) * uniform(); }

double Rng::normal() {
  const double u = 1.0 - uniform();  // (0, 1]: the logarithm is finite
  const double v = uniform();
  return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * kPi * v);
}

std::size_t Rng::index(std::size_t n) {
  // Lemire's multiply-shift with rejection.
  const auto bound = static_cast<std::uint64_t>(n);
  const std::uint64_t threshold = (0 - bound) % bound;
  for (;;) {
    const auto product = static_cast<Wide>(next()) * bound;
    if (static_cast<std::uint64_t>(product) >= threshold) return static_cast<std::size_t>(product >> 64);
  }
}

std::vector<std::size_t> Rng::permutation(std::size_t n) {
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  for (std::size_t i = n; i > 1; --i) std::swap(order[i - 1], order[index(i)]);
  return order;
}

}  // namespace anigen
