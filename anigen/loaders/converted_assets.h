#pragma once
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"
#include "anigen/loaders/broken_assets.h"
#include "anigen/loaders/metadata.h"
#include "anigen/loaders/rigged_item.h"

namespace anigen::loaders {

/// Prepared assets as samples of a baseline's own kind, held in memory.
template <typename Sample>
struct ConvertedAssets {
  std::vector<Sample> samples;
  std::vector<std::size_t> repeat;                ///< how often an epoch visits each
  std::vector<std::string> unreadable, rejected;  ///< the others: what is wrong, with the id

  /// @param problem why the sample cannot be used; empty: it can
  void add(Sample sample, std::size_t times, const std::string& id, const std::string& problem) {
    if (!problem.empty()) {
      rejected.push_back(id + ": " + problem);
      return;
    }
    samples.push_back(std::move(sample));
    repeat.push_back(times);
  }

  /// Counts and names what was left out. @param purpose for messages, as in "left to train on"
  /// @throws InputError for unreadable ones unless skip_broken, and when nothing is left
  void report(bool skip_broken, const char* purpose) const {
    report_broken(unreadable, samples.size() + unreadable.size() + rejected.size(), skip_broken);
    for (const std::string& problem : rejected) log::debug("left out: {}", problem);
    if (!rejected.empty()) {
      log::info("{} of {} assets to {} left out, such as {}", rejected.size(), samples.size() + rejected.size(),
                purpose, rejected.front());
    }
    if (samples.empty()) throw InputError("", "dataset", std::string("there is nothing left to ") + purpose);
  }
};

/// Reads all assets and converts them, on all threads; the result is in the order of the assets.
/// @param convert Sample(const RiggedItem&), whose InputErrors reject the asset
/// @param problem std::string(const Sample&): why it cannot be used, or ""
template <typename Sample, typename Convert, typename Problem>
ConvertedAssets<Sample> convert_assets(const std::vector<AssetId>& assets, Convert convert, Problem problem) {
  struct Read {
    Sample sample;
    std::string unreadable, rejected;
  };
  std::vector<Read> read(assets.size());
  Progress progress("converting rigs", assets.size(), "assets");
  parallel_for(assets.size(), [&](std::size_t i) {
    RiggedItem item;
    try {
      item = read_rigged_item(assets[i]);
    } catch (const InputError& error) {
      read[i].unreadable = error.what();
      return;
    }
    try {
      read[i].sample = convert(item);
    } catch (const InputError& error) {
      read[i].rejected = error.what();
    }
    progress.advance();
  });
  progress.finish();
  ConvertedAssets<Sample> all;
  for (std::size_t i = 0; i < assets.size(); ++i) {
    if (!read[i].unreadable.empty()) {
      all.unreadable.push_back(read[i].unreadable);
    } else if (!read[i].rejected.empty()) {
      all.rejected.push_back(read[i].rejected);
    } else {
      const std::string why = problem(read[i].sample);
      all.add(std::move(read[i].sample), assets[i].repeat, assets[i].id, why);
    }
  }
  return all;
}

}  // namespace anigen::loaders
