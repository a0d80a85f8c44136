#pragma once
#include <cstddef>
#include <numeric>
#include <vector>

namespace anigen {

/// Disjoint sets of the numbers 0 … n − 1 (union–find with path halving): which of them hang together.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t count) : above_(count), sizes_(count, 1) {
    std::iota(above_.begin(), above_.end(), std::size_t{0});
  }

  /// The member that stands for the set of i.
  std::size_t find(std::size_t i) {
    while (above_[i] != i) i = above_[i] = above_[above_[i]];
    return i;
  }
  bool same(std::size_t a, std::size_t b) { return find(a) == find(b); }
  std::size_t size_of(std::size_t i) { return sizes_[find(i)]; }

  /// Makes one set of two; the first one's representative stays. @return whether they were two
  bool join(std::size_t a, std::size_t b) {
    a = find(a);
    b = find(b);
    if (a == b) return false;
    above_[b] = a;
    sizes_[a] += sizes_[b];
    return true;
  }
  /// As join(); the lower representative stays, and so every set is represented by its lowest member.
  bool join_lowest(std::size_t a, std::size_t b) { return find(a) < find(b) ? join(a, b) : join(b, a); }

 private:
  std::vector<std::size_t> above_, sizes_;  // sizes of representatives
};

}  // namespace anigen
