#pragma once
#include <cstddef>
#include <new>
#include <vector>

namespace anigen::nn::kernels {

/// Allocates on cache lines: a vector register that is loaded across two lines takes twice as long.
template <typename T>
struct CacheLineAllocator {
  using value_type = T;
  static constexpr std::align_val_t kLine{64};

  CacheLineAllocator() = default;
  template <typename Other>
  CacheLineAllocator(const CacheLineAllocator<Other>&) {}

  T* allocate(std::size_t count) { return static_cast<T*>(::operator new(count * sizeof(T), kLine)); }
  void deallocate(T* values, std::size_t) { ::operator delete(values, kLine); }

  template <typename Other>
  bool operator==(const CacheLineAllocator<Other>&) const {
    return true;
  }
  template <typename Other>
  bool operator!=(const CacheLineAllocator<Other>&) const {
    return false;
  }
};

/// Numbers that kernels load by whole vector registers.
template <typename T>
using AlignedVector = std::vector<T, CacheLineAllocator<T>>;

}  // namespace anigen::nn::kernels
