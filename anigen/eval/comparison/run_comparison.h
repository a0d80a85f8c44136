#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/eval/comparison/comparison.h"
#include "anigen/eval/image/views.h"
#include "anigen/eval/inputs/pairs.h"
#include "anigen/eval/motion/motion.h"
#include "anigen/eval/pair/pair_settings.h"
#include "anigen/eval/surface/category_references.h"
#include "anigen/io/rigs/shape_source.h"

namespace anigen::eval {

/// One set of predictions under one name.
struct ComparedMethod {
  std::string label;
  std::shared_ptr<const io::ShapeSource> predictions, truths;
  std::vector<PairPlan> pairs;
};

struct ComparisonRun {
  PairSettings settings;
  PerceptualDistance perceptual;  ///< LPIPS of two pictures, called from several threads; settings.lpips describes it
  const CategoryReferences* categories = nullptr;  ///< settings.categories describes them
  const Motion* motion = nullptr;  ///< that every truth is given in place of its own; settings.motion describes it
  std::filesystem::path cache;     ///< results of pairs, one file each: an interrupted run goes on from there
  bool resume = true;              ///< false: compute everything again
  bool accept_other_code = false;  ///< a saved result counts whatever build of the program made it
};

/// Evaluates every pair of every method, several at once (set_thread_count). Rows are those of the first method;
/// where another one has no pair of that id, that is a failure. What a pair throws is its failure and stops nothing.
/// A saved result counts only for equal shapes, settings and commit (core/version.h); how many are of another commit is
/// said once. Several processes with one `cache` share the
/// pairs by leases: each returns all results, of which it computed some and read the others.
/// @throws InputError without methods or pairs; Interrupted after Ctrl-C, with finished pairs saved
Comparison run_comparison(const std::vector<ComparedMethod>& methods, const ComparisonRun& run);

}  // namespace anigen::eval
