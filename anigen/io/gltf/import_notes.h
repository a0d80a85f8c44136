#pragma once
#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/io/gltf.h"

namespace anigen::io::gltf_import {

/// Collects what the importer changed, in the order it happened; one note per kind of change however often it
/// happened, so that a broken file of a million vertices does not report a million times.
class Notes {
 public:
  /// A sentence, once.
  void add(const std::string& code, const std::string& sentence);
  /// Counts; the note reads "<count> <what>", for example "6 vertices with weights that are not numbers".
  void tally(const std::string& code, const std::string& what, std::size_t count = 1);
  /// What the weights of a vertex sum to in the file.
  void weight_sum(double sum) { lowest_weight_sum_ = std::min(lowest_weight_sum_, sum); }
  /// Of all vertices with weights; 1 when there are none, or all sum to more.
  double lowest_weight_sum() const { return lowest_weight_sum_; }
  std::vector<ImportNote> take() const;

  struct Entry {
    std::string code, text;
    std::size_t count;  ///< 0: a sentence
  };
  const std::vector<Entry>& entries() const { return entries_; }

 private:
  std::vector<Entry> entries_;
  double lowest_weight_sum_ = 1.0;
};

}  // namespace anigen::io::gltf_import
