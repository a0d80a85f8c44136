#include "anigen/eval/study/metric_study.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"
#include "anigen/eval/pair/metric_table.h"
#include "anigen/eval/pair/pair_evaluation.h"
#include "anigen/eval/skin_evaluation.h"
#include "anigen/eval/study/perturbations.h"

namespace anigen::eval {
namespace {

/// Distances that are zero between equal shapes. UniRig's J2B is not among them: its samples leave out one end of every
/// bone, so a joint without children is not on any.
const std::vector<std::string>& zero_keys() {
  static const std::vector<std::string> kKeys = {
      "j2j",          "j2b",        "b2b",        "wasserstein",       "gromov_wasserstein", "fused_gromov_wasserstein",
      "skin_l1",      "skin_l2",    "skin_kl",    "deformation_error", "surface_chamfer",    "rignet.j2j",
      "rignet.j2b",   "rignet.b2b", "unirig.j2j", "unirig.b2b",        "puppeteer.j2j",      "puppeteer.j2b",
      "puppeteer.b2b"};
  return kKeys;
}

bool is_skeleton_key(const std::string& key) {
  const MetricInfo* metric = find_metric(key);
  return metric != nullptr && (metric->group == "skeleton" || metric->group == "transport");
}

struct Largest {
  double value = 0;
  std::string key;
};

/// The largest finite value of the keys; divergences may be negative by rounding.
Largest largest(const PairResult& result, bool skeleton_only) {
  Largest found;
  for (const std::string& key : zero_keys()) {
    if (skeleton_only && !is_skeleton_key(key)) continue;
    const double value = std::abs(result.value(key));
    if (std::isfinite(value) && value >= found.value) found = {value, key};
  }
  return found;
}

std::string scientific(double value) {
  if (value == 0) return "0";
  char text[32];
  std::snprintf(text, sizeof text, "%.1e", value);
  return text;
}

PairSettings unaligned() {
  PairSettings settings;
  settings.alignment.icp = false;
  settings.alignment.normalization = NormalizationMode::kBoundingBox;
  settings.groups = {"skeleton", "transport", "skin"};
  return settings;
}

/// How far a metric is from perfect.
double loss(const PairResult& result, const MetricInfo& metric) {
  const double value = result.value(metric.key);
  return metric.better == Better::kHigher ? 1.0 - value : value;
}

std::string word(Expected expected) {
  switch (expected) {
    case Expected::kZero:
      return "about 0";
    case Expected::kPositive:
      return "> 0";
    case Expected::kOpen:
      break;
  }
  return "open";
}

double median(std::vector<double> values) { return summarize(std::move(values)).median; }

}  // namespace

Table self_evaluation(const std::vector<io::RiggedShape>& shapes, const PairSettings& settings) {
  Table table;
  table.columns = {"shape",     "joints",         "itself, largest", "of",  "moved: skeleton", "of",
                   "moved: GW", "moved: skin l1", "moved: Chamfer",  "ICP", "seconds"};
  table.rows.resize(shapes.size());
  Progress progress("shapes against themselves", shapes.size(), "shapes");
  parallel_for(shapes.size(), [&](std::size_t i) {
    const io::RiggedShape& shape = shapes[i];
    try {
      const PairResult itself = evaluate_pair(shape, shape, settings);
      const PairResult moved = evaluate_pair(with_random_placement(shape, i), shape, settings);
      const Largest exact = largest(itself, false), off = largest(moved, true);
      table.rows[i] = {shape.id,
                       std::to_string(shape.joints.size()),
                       scientific(exact.value),
                       exact.key,
                       scientific(off.value),
                       off.key,
                       scientific(moved.value("gromov_wasserstein")),
                       scientific(moved.value("skin_l1")),
                       scientific(moved.value("surface_chamfer")),
                       scientific(moved.value("icp_rmse")),
                       fixed(moved.value("seconds"), 2)};
    } catch (const InputError& error) {
      table.rows[i] = {shape.id, std::to_string(shape.joints.size()), error.what(), "", "", "", "", "", "", "", ""};
    }
    progress.advance();
  });
  return table;
}

MistakeResults evaluate_mistakes(const std::vector<io::RiggedShape>& shapes) {
  const auto& mistakes = perturbations();
  MistakeResults results(mistakes.size(), std::vector<PairResult>(shapes.size()));
  Progress progress("mistakes", mistakes.size() * shapes.size(), "pairs");
  parallel_for(mistakes.size() * shapes.size(), [&](std::size_t i) {
    PairResult& result = results[i / shapes.size()][i % shapes.size()];
    const io::RiggedShape& shape = shapes[i % shapes.size()];
    try {
      result = evaluate_pair(mistakes[i / shapes.size()].apply(shape), shape, unaligned());
    } catch (const InputError& error) {
      result.failure = error.what();
    }
    progress.advance();
  });
  return results;
}

Table sensitivity(const MistakeResults& results) {
  Table table;
  table.columns = {"mistake", "metric", "expected", "median", "smallest", "largest", "held on"};
  const auto& mistakes = perturbations();
  for (std::size_t p = 0; p < mistakes.size(); ++p) {
    for (const auto& [key, expected] : mistakes[p].expected) {
      const MetricInfo& metric = *find_metric(key);
      std::vector<double> values;
      std::size_t held = 0;
      for (const PairResult& result : results[p]) {
        const double value = loss(result, metric);
        if (!std::isfinite(value)) continue;
        values.push_back(value);
        held += (std::abs(value) < kStudyZero) == (expected == Expected::kZero) ? 1u : 0u;
      }
      if (values.empty()) continue;
      const auto [low, high] = std::minmax_element(values.begin(), values.end());
      const std::string name = metric.better == Better::kHigher ? "1 − " + key : key;
      table.rows.push_back(
          {mistakes[p].name, name, word(expected), fixed(median(values), 5), fixed(*low, 5), fixed(*high, 5),
           expected == Expected::kOpen ? "" : std::to_string(held) + " of " + std::to_string(values.size())});
    }
  }
  return table;
}

Table conventions(const MistakeResults& results) {
  Table table;
  table.columns = {"mistake", "convention", "J2J", "J2B", "B2B", "J2J / paper", "J2B / paper", "B2B / paper"};
  const auto& mistakes = perturbations();
  for (std::size_t p = 0; p < mistakes.size(); ++p) {
    double paper[3] = {0, 0, 0};
    for (const std::string prefix : {"", "rignet.", "unirig.", "puppeteer."}) {
      std::vector<std::string> row = {mistakes[p].name, prefix.empty() ? "paper" : prefix.substr(0, prefix.size() - 1)};
      std::vector<std::string> ratios;
      int column = 0;
      for (const char* key : {"j2j", "j2b", "b2b"}) {
        std::vector<double> values;
        for (const PairResult& result : results[p]) {
          const double value = result.value(prefix + key);
          if (std::isfinite(value)) values.push_back(value);
        }
        const double mean = summarize(values).mean;
        if (prefix.empty()) paper[column] = mean;
        row.push_back(fixed(mean, 5));
        ratios.push_back(paper[column] > 1e-9 ? fixed(mean / paper[column], 2) : "–");
        ++column;
      }
      row.insert(row.end(), ratios.begin(), ratios.end());
      // Blurred weights leave every skeleton metric at zero: nothing to compare.
      if (paper[0] > 0 || paper[1] > 0 || paper[2] > 0) table.rows.push_back(std::move(row));
    }
  }
  return table;
}

Table degenerate_inputs(const io::RiggedShape& shape) {
  Table table;
  table.columns = {"prediction", "what becomes of it"};
  PairSettings settings = unaligned();
  settings.groups.insert({"surface", "anymate"});
  settings.surface_samples = 1000;
  const auto add = [&](const std::string& name, io::RiggedShape changed) {
    std::string text;
    try {
      const PairResult result = evaluate_pair(changed, shape, settings);
      text = "j2j " + fixed(result.value("j2j")) + ", W " + fixed(result.value("wasserstein")) + ", GW " +
             fixed(result.value("gromov_wasserstein")) + ", skin l1 " + fixed(result.value("skin_l1")) + ", Chamfer " +
             fixed(result.value("surface_chamfer"));
      std::vector<std::string> reasons;
      for (const auto& [key, reason] : result.not_computed) {
        if (std::find(reasons.begin(), reasons.end(), reason) == reasons.end() && find_metric(key)->group != "run")
          reasons.push_back(reason);
      }
      for (const std::string& reason : reasons) text += "; " + reason;
    } catch (const InputError& error) {
      text = std::string("error: ") + error.what();
    }
    table.rows.push_back({name, text});
  };
  const auto one_joint = [](SkinWeights skin) {
    SkinWeights result;
    for (std::size_t v = 0; v < skin.rows(); ++v) result.append_row({{0, 1.0f}});
    return result;
  };

  io::RiggedShape changed = shape;
  changed.joints = {};
  changed.skin = {};
  add("no skeleton", changed);
  changed = shape;
  changed.joints = {{shape.joints.positions[0]}, {-1}};
  changed.skin = one_joint(shape.skin);
  add("a single joint", changed);
  changed = shape;
  for (int& parent : changed.joints.parents) parent = -1;
  add("a forest: every joint a root", changed);
  changed = shape;
  changed.joints.positions[1] = changed.joints.positions[0];
  add("two joints in one place", changed);
  changed = shape;
  changed.joints.positions[1].x() = std::numeric_limits<double>::quiet_NaN();
  add("a joint at NaN", changed);
  changed = shape;
  changed.joints.parents[0] = static_cast<int>(shape.joints.size()) - 1;
  add("a cycle", changed);
  changed = shape;
  changed.skin.offsets.pop_back();
  changed.skin.influences.resize(changed.skin.offsets.back());
  add("weights for one vertex too few", changed);
  changed = shape;
  changed.mesh.faces.clear();
  add("a mesh without faces", changed);
  changed = shape;
  changed.mesh = {};
  changed.skin = {};
  add("no mesh at all", changed);
  return table;
}

}  // namespace anigen::eval
