#pragma once
#include <cstddef>
#include <memory>
#include <new>
#include <vector>

namespace anigen::curve_skeleton {

/// Memory whose addresses ascend in the order of allocation, for code that sorts by address: what it does then no
/// longer depends on where the heap had room. Nothing is given back before the end of the scope. One thread's own.
class OrderedMemory {
 public:
  /// From here to the end of the scope the calling thread's OrderedAllocator takes its memory here.
  /// @param bytes in one block; only what is touched takes memory. Blocks after the first may lie anywhere.
  explicit OrderedMemory(std::size_t bytes) : block_bytes_(bytes), before_(current()) { current() = this; }
  ~OrderedMemory() { current() = before_; }
  OrderedMemory(const OrderedMemory&) = delete;
  OrderedMemory& operator=(const OrderedMemory&) = delete;

  static OrderedMemory*& current() {
    thread_local OrderedMemory* memory = nullptr;
    return memory;
  }

  void* allocate(std::size_t bytes) {
    bytes = (bytes + kAlignment - 1) / kAlignment * kAlignment;
    if (blocks_.empty() || block_size_ - used_ < bytes) {
      block_size_ = bytes > block_bytes_ ? bytes : block_bytes_;
      // Not make_unique, which would touch every page.
      blocks_.emplace_back(new unsigned char[block_size_]);
      used_ = 0;
    }
    void* const result = blocks_.back().get() + used_;
    used_ += bytes;
    return result;
  }

 private:
  static constexpr std::size_t kAlignment = 16;
  std::size_t block_bytes_, block_size_ = 0, used_ = 0;
  std::vector<std::unique_ptr<unsigned char[]>> blocks_;
  OrderedMemory* before_;
};

/// Whatever it allocates must be gone before the OrderedMemory around it. @pre there is one
template <typename T>
struct OrderedAllocator {
  using value_type = T;
  OrderedAllocator() = default;
  template <typename U>
  OrderedAllocator(const OrderedAllocator<U>&) {}
  T* allocate(std::size_t n) { return static_cast<T*>(OrderedMemory::current()->allocate(n * sizeof(T))); }
  void deallocate(T*, std::size_t) {}
  template <typename U>
  bool operator==(const OrderedAllocator<U>&) const {
    return true;
  }
  template <typename U>
  bool operator!=(const OrderedAllocator<U>&) const {
    return false;
  }
};

}  // namespace anigen::curve_skeleton
