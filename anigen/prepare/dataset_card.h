#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/table.h"
#include "anigen/prepare/dataset.h"

namespace anigen::prepare {

struct HistogramBin {
  double low = 0, high = 0;  ///< [low, high), the last one closed
  std::size_t count = 0;
};

/// Histogram of numbers: with equal bins of a round width, or, when they span more than two decades, bins at 1, 2, 5,
/// 10, 20, … @return at most `most` bins, none without values
std::vector<HistogramBin> histogram(const std::vector<double>& values, std::size_t most = 12);

/// An <svg> of its own: a bar per bin, its count above and its lower bound below. Empty without bins.
std::string histogram_svg(const std::vector<HistogramBin>& bins);

/// A small table of the card: header, then rows.
struct CardTable {
  std::string title;
  std::string note;  ///< a sentence under it; may be empty
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
};

struct CardHistogram {
  std::string title, spread;  ///< spread: least, most, median and mean in words
  std::vector<HistogramBin> bins;
};

/// Everything the card says, before it is Markdown or HTML.
struct CardFacts {
  std::vector<std::vector<std::string>> counts;  ///< name and number
  std::vector<CardTable> tables;                 ///< without rows: left out
  std::vector<CardHistogram> histograms;
  std::string settings;  ///< the plan as JSON
};

/// @param columns of metadata.csv @param picture card.png is there
std::string card_markdown(const CardFacts& facts, const std::vector<std::string>& columns, bool picture);

/// One file without references to others. @param picture PNG bytes; empty: none
std::string card_html(const CardFacts& facts, const std::vector<std::string>& columns,
                      const std::vector<std::uint8_t>& picture);

/// Writes what a dataset is at a glance: card.html (one file, pictures inside), card.md with card.png. Counts, sources,
/// histograms of joints, vertices and voxels, what cleaning did, what failed, how everything was made, and pictures of
/// assets spread evenly over the dataset, each with its skeleton drawn over it. Equal datasets give equal bytes.
void write_card(const std::filesystem::path& out, const DatasetRows& found, const PrepareSummary& summary,
                const CsvTable& table, const StepPlan& plan);

}  // namespace anigen::prepare
