#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/io/rigs/shape_source.h"

namespace anigen::eval {

/// One row of an evaluation: a truth and, when there is one, its prediction.
struct PairPlan {
  std::string id;                            ///< what the row is called
  std::string truth_id;                      ///< in the truth's source
  std::optional<std::string> prediction_id;  ///< in the prediction's source
  std::string missing_reason;                ///< why there is no prediction; empty when there is
};

struct PairList {
  std::vector<PairPlan> pairs;      ///< one per truth asked for, in that order
  std::vector<std::string> unused;  ///< predictions that belong to none of them
};

/// Finds each truth's prediction: the one of equal id; else the one that io::NameIndex finds by any name of the truth
/// (uuid, sha256, path, "<shard>#<uuid>"), by the sha256 of the truth's content, or by the folder that the prediction
/// lies in. Two single files are a pair whatever their names.
/// @param truth_ids ids of `truth`, each once (select_ids)
/// @throws InputError naming the candidates when two predictions could be meant for one truth, or two truths by one
/// prediction
PairList match_pairs(const io::ShapeSource& truth, const io::ShapeSource& prediction,
                     const std::vector<std::string>& truth_ids);

/// Both sides of a CSV of pairs, and the rows.
struct PairedSources {
  std::unique_ptr<io::ShapeSource> truth, prediction;
  PairList list;
};

/// Reads a CSV with the header pred,gt and optionally id. Each cell is the path of a file with one shape, relative to
/// the CSV. Rows are called by their id, else by the truth's file name without extension. An empty or missing `pred`
/// is a row with its reason; a missing `gt` shows when it is read.
/// @throws InputError naming the row: a column or a truth missing, two rows with one id
PairedSources read_pairs_csv(const std::filesystem::path& csv, const io::SourceOptions& truth_options = {},
                             const io::SourceOptions& prediction_options = {});

}  // namespace anigen::eval
