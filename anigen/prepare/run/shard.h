#pragma once
#include <cstddef>
#include <string>

namespace anigen::prepare {

/// One part of a run that is spread over several machines: the sources whose number is `index` modulo `count`.
struct Shard {
  std::size_t index = 0, count = 1;

  bool whole() const { return count == 1; }
  bool owns(std::size_t source) const { return source % count == index; }
  /// "0-of-1", as file names of the run folder carry it.
  std::string name() const { return std::to_string(index) + "-of-" + std::to_string(count); }
  bool operator==(const Shard& other) const { return index == other.index && count == other.count; }
};

/// "i/n" with 0 ≤ i < n. @throws InputError naming --shard
Shard parse_shard(const std::string& text);

}  // namespace anigen::prepare
