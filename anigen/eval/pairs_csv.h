#pragma once
#include <filesystem>
#include <memory>

#include "anigen/eval/pairs.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

/// Both sides of a CSV of pairs, and the rows.
struct PairedSources {
  std::unique_ptr<io::ShapeSource> truth, prediction;
  PairList list;
};

/// Reads a CSV with the header pred,gt and optionally id. Each cell is the path of a file with one shape, relative to
/// the CSV, or one sample of a file with many, FILE#SAMPLE, by its id or its number from 0; every such file is opened
/// once, when the first of its samples is read. Rows are called by their id, else by the truth's file name without
/// extension or its sample; a number with its file's name. An empty or missing `pred` is a row with its reason; a
/// missing `gt` shows when it is read.
/// @throws InputError naming the row: a column or a truth missing, two rows with one id
PairedSources read_pairs_csv(const std::filesystem::path& csv, const io::SourceOptions& truth_options = {},
                             const io::SourceOptions& prediction_options = {});

}  // namespace anigen::eval
