#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

namespace anigen {

/// A stream of random numbers named by (seed, purpose, index). Every consumer derives its own stream, so no draw
/// depends on the number of threads, on worker order or on what other code drew before; the same on every
/// platform, since distributions are ours and not the standard library's. Counter-based (SplitMix64 of a counter,
/// Steele et al. 2014), so its whole state is two integers and resuming is exact.
class Rng {
 public:
  Rng(std::uint64_t seed, std::string_view purpose, std::uint64_t index = 0);

  std::uint64_t next();                     ///< 64 uniform bits
  double uniform();                         ///< [0, 1), 53 bits
  double uniform(double low, double high);  ///< [low, high)
  double normal();                          ///< mean 0, standard deviation 1 (Box–Muller, no cached half)
  std::size_t index(std::size_t n);         ///< uniform in [0, n), n > 0, without modulo bias
  bool chance(double probability) { return uniform() < probability; }  ///< true with that probability
  std::vector<std::size_t> permutation(std::size_t n);                 ///< Fisher–Yates

  std::array<std::uint64_t, 2> state() const { return {key_, counter_}; }
  static Rng from_state(std::array<std::uint64_t, 2> state);

 private:
  Rng() = default;
  std::uint64_t key_ = 0, counter_ = 0;
};

/// Ranges of the seeds of procedural creatures. Those between the two are free.
namespace creature_seeds {

/// Kept for testing: anigen-prepare marks all these creatures as test assets, and no training takes one.
inline constexpr std::uint64_t kFirstTest = 900'000'000, kLastTest = 999'999'999;
/// Of `anigen-prepare --stream`, which draws from here on; none of these may be a test asset.
inline constexpr std::uint64_t kFirstOfStreams = 1'000'000'000'000;

inline constexpr bool is_test(std::uint64_t seed) { return seed >= kFirstTest && seed <= kLastTest; }

}  // namespace creature_seeds

/// 64-bit hash of bytes (FNV-1a finished with a SplitMix64 mix); stable across runs and platforms.
std::uint64_t stable_hash(std::string_view bytes, std::uint64_t seed = 0);

}  // namespace anigen
