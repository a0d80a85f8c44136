#include "anigen/eval/comparison.h"

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <exception>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/lease.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/random.h"
#include "anigen/core/version.h"
#include "anigen/eval/method_differences.h"
#include "anigen/eval/skeleton_groups.h"

namespace anigen::eval {

namespace {

Json summary_json(const Comparison& comparison, std::size_t method) {
  Json summary = Json::object();
  for (const MetricInfo& metric : metric_table()) {
    const MetricSummary of = summarize_metric(comparison, method, metric.key);
    Json& json = summary[metric.key] = to_json(of.summary);
    if (of.summary.n > 0) json.update({{"low", of.interval.low}, {"high", of.interval.high}});
  }
  return summary;
}

Json asset_json(const PairResult& result) {
  Json json = {{"id", result.id}};
  if (!result.failure.empty()) json["failure"] = result.failure;
  // A failed asset has no values; every other one says of each metric what it is or why it is not there.
  for (const MetricInfo& metric : metric_table()) {
    const double value = result.value(metric.key);
    json[metric.key] = std::isfinite(value) ? Json(value) : Json(nullptr);
  }
  json["not_computed"] = result.not_computed;
  json["notes"] = result.notes;
  json["details"] = result.details;
  return json;
}

Json assets_json(const Comparison& comparison, std::size_t method) {
  Json assets = Json::array();
  for (const PairResult& result : comparison.results[method]) assets.push_back(asset_json(result));
  return assets;
}

void add_section(std::string& text, const std::string& title, const anigen::Table& table) {
  if (!table.rows.empty()) text += "\n## " + title + "\n\n" + to_markdown(table);
}

namespace fs = std::filesystem;

constexpr const char* kLeases = ".leases";
/// Pairs between two returns of freed memory to the system.
constexpr std::size_t kPairsPerRelease = 64;

/// Key for which a saved result is valid.
std::string stamp(const PairSettings& settings, const CategoryQuestion& category, const io::RiggedShape& predicted,
                  const io::RiggedShape& truth) {
  const std::string asked = category.references == nullptr ? "" : "\n" + category.expected + "\n" + category.truth_id;
  const std::uint64_t hash = stable_hash(to_json(settings).dump() + kVersion + asked, fingerprint(predicted));
  return std::to_string(hash) + "-" + std::to_string(fingerprint(truth));
}

bool load(const fs::path& path, const std::string& wanted, bool accept_other_code, PairResult& result) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) return false;
  try {
    const Json json = read_json(path);
    if (json.value("stamp", "") != wanted) return false;
    PairResult found = pair_result_from_json(json, path.string());
    if (found.commit != commit() && !accept_other_code) return false;
    result = std::move(found);
    return true;
  } catch (const InputError& error) {
    log::warn("{}: computed again", error.what());
    return false;
  }
}

fs::path saved_file(const ComparisonRun& run, const std::string& label, const std::string& id) {
  return run.cache / file_name(label) / (file_name(id) + ".json");
}

/// Says once which saved results another build of the program made, and that they do not count.
void tell_of_other_code(const std::vector<ComparedMethod>& methods, const ComparisonRun& run) {
  if (!run.resume || run.accept_other_code) return;
  std::size_t count = 0;
  std::string by;
  for (const ComparedMethod& method : methods) {
    for (const PairPlan& pair : method.pairs) {
      const fs::path file = saved_file(run, method.label, pair.id);
      std::error_code ignored;
      if (!fs::exists(file, ignored)) continue;
      try {
        const std::string found = read_json(file).value("commit", "");
        if (found == commit()) continue;
        if (count++ == 0) by = found;
      } catch (const std::exception&) {  // damaged: said when the pair's turn comes
      }
    }
  }
  if (count == 0) return;
  log::warn("{} saved results of pairs were made by {}; {} computes them again (--accept-other-code keeps them)", count,
            named_commit(by), named_commit(commit()));
}

PairResult evaluate(const PairPlan& pair, const ComparedMethod& method, const ComparisonRun& run) {
  PairResult result;
  try {
    if (!pair.prediction_id) throw InputError("", "", pair.missing_reason);
    const io::RiggedShape truth = method.truths->read(pair.truth_id);
    const io::RiggedShape predicted = method.predictions->read(*pair.prediction_id);
    CategoryQuestion category;
    if (run.categories != nullptr) category = {run.categories, method.truths->category(pair.truth_id), pair.truth_id};
    const std::string wanted = stamp(run.settings, category, predicted, truth);
    const fs::path saved = saved_file(run, method.label, pair.id);
    if (run.resume && load(saved, wanted, run.accept_other_code, result)) {
      result.id = pair.id;
      return result;
    }
    result = evaluate_pair(predicted, truth, run.settings, run.perceptual, category, run.motion);
    result.id = pair.id;
    result.commit = commit();
    Json json = to_json(result);
    json["stamp"] = wanted;
    write_file_atomically(saved, json.dump(1) + "\n");
  } catch (...) {
    result = {};
    result.failure = failure_of_item();
  }
  result.id = pair.id;
  return result;
}

}  // namespace

std::vector<double> metric_values(const Comparison& comparison, std::size_t method, const std::string& key) {
  std::vector<double> values;
  for (const PairResult& result : comparison.results[method]) values.push_back(result.value(key));
  return values;
}

Interval bootstrap_mean(const std::vector<double>& values, std::uint64_t seed, const std::string& purpose,
                        std::size_t draws) {
  const std::size_t n = values.size();
  if (n == 0 || draws == 0) return {};
  Rng rng(seed, "bootstrap " + purpose);
  std::vector<double> means(draws);
  for (double& mean : means) {
    double sum = 0;
    for (std::size_t i = 0; i < n; ++i) sum += values[rng.index(n)];
    mean = sum / static_cast<double>(n);
  }
  std::sort(means.begin(), means.end());
  const auto at = [&](double quantile) {
    return means[static_cast<std::size_t>(std::lround(quantile * static_cast<double>(draws - 1)))];
  };
  return {at(0.025), at(0.975)};
}

bool numerically_equal(double a, double b) {
  constexpr double kSinglePrecision = std::numeric_limits<float>::epsilon();
  return std::abs(a - b) <= kSinglePrecision * std::max({1.0, std::abs(a), std::abs(b)});
}

double difference(double a, double b) { return numerically_equal(a, b) ? 0.0 : a - b; }

std::vector<int> places(const std::vector<double>& means, bool lower_is_better) {
  std::vector<int> result(means.size(), 0);
  for (std::size_t m = 0; m < means.size(); ++m) {
    if (!std::isfinite(means[m])) continue;
    const auto better = std::count_if(means.begin(), means.end(), [&](double other) {
      return std::isfinite(other) && (lower_is_better ? difference(other, means[m]) : difference(means[m], other)) < 0;
    });
    if (better < 2) result[m] = static_cast<int>(better) + 1;
  }
  return result;
}

PairedDifference paired_difference(const std::vector<double>& first, const std::vector<double>& second,
                                   std::uint64_t seed, const std::string& purpose) {
  std::vector<double> differences;
  for (std::size_t i = 0; i < std::min(first.size(), second.size()); ++i) {
    if (std::isfinite(first[i]) && std::isfinite(second[i])) differences.push_back(difference(first[i], second[i]));
  }
  PairedDifference result;
  result.n = differences.size();
  if (result.n == 0) return result;
  result.equal = std::all_of(differences.begin(), differences.end(), [](double d) { return d == 0.0; });
  result.mean = std::accumulate(differences.begin(), differences.end(), 0.0) / static_cast<double>(result.n);
  result.interval = bootstrap_mean(differences, seed, "difference " + purpose);
  return result;
}

MetricSummary summarize_metric(const Comparison& comparison, std::size_t method, const std::string& key) {
  std::vector<double> values = metric_values(comparison, method, key);
  values.erase(std::remove_if(values.begin(), values.end(), [](double v) { return !std::isfinite(v); }), values.end());
  MetricSummary result;
  result.interval = bootstrap_mean(values, comparison.seed, key);
  result.summary = summarize(values);
  return result;
}

std::size_t failures(const Comparison& comparison, std::size_t method) {
  const auto& results = comparison.results[method];
  return static_cast<std::size_t>(
      std::count_if(results.begin(), results.end(), [](const PairResult& r) { return !r.failure.empty(); }));
}

std::vector<const MetricInfo*> present_metrics(const Comparison& comparison, bool headline) {
  std::vector<const MetricInfo*> result;
  for (const MetricInfo& info : metric_table()) {
    if (headline && !info.headline) continue;
    bool present = false;
    for (const auto& method : comparison.results) {
      present = present || std::any_of(method.begin(), method.end(),
                                       [&](const PairResult& r) { return r.values.find(info.key) != r.values.end(); });
    }
    if (present) result.push_back(&info);
  }
  return result;
}

Json to_json(const Comparison& comparison) {
  Json json;
  json["settings"] = comparison.settings;
  json["method"] = comparison.methods[0];
  json["summary"] = summary_json(comparison, 0);
  json["failed"] = failures(comparison, 0);
  json["assets"] = assets_json(comparison, 0);
  json["methods"] = Json::object();
  json["differences"] = Json::object();
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    json["methods"][comparison.methods[m]] = {{"summary", summary_json(comparison, m)},
                                              {"failed", failures(comparison, m)},
                                              {"assets", assets_json(comparison, m)}};
    if (m == 0) continue;
    Json& differences = json["differences"][comparison.methods[m]];
    differences = Json::object();
    for (const MetricInfo& metric : metric_table()) {
      const PairedDifference of = difference_to_first(comparison, m, metric.key);
      if (of.n == 0) continue;
      differences[metric.key] = {
          {"mean", of.mean}, {"low", of.interval.low}, {"high", of.interval.high}, {"n", of.n}, {"equal", of.equal}};
      if (!measured_alike(comparison, 0, m, metric.key)) differences[metric.key]["measured_alike"] = false;
    }
  }
  if (const auto skeletons = by_skeleton(comparison)) json["over_skeletons"] = skeleton_json(*skeletons);
  json["unused_predictions"] = comparison.unused;
  for (std::size_t m = 0; m < comparison.pairing.size(); ++m) {
    const Pairing& pairing = comparison.pairing[m];
    json["pairing"][comparison.methods[m]] = {
        {"paired", pairing.paired}, {"missing", pairing.missing}, {"unused", pairing.unused}};
  }
  return json;
}

CsvTable to_csv_table(const Comparison& comparison) {
  CsvTable table{{"id", "method", "failure"}, {}};
  for (const MetricInfo& metric : metric_table()) table.columns.push_back(metric.key);
  for (std::size_t i = 0; i < comparison.ids.size(); ++i) {
    for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
      const PairResult& result = comparison.results[m][i];
      std::vector<std::string> row = {result.id, comparison.methods[m], result.failure};
      for (const MetricInfo& metric : metric_table()) {
        const double value = result.value(metric.key);
        row.push_back(std::isfinite(value) ? Json(value).dump() : "");
      }
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

anigen::Table method_table(const Comparison& comparison, const std::vector<const MetricInfo*>& metrics,
                           bool with_failures) {
  anigen::Table table{{"method"}, {}};
  if (with_failures) table.columns.insert(table.columns.end(), {"assets", "failed"});
  for (const MetricInfo* metric : metrics) table.columns.push_back(column_head(*metric));
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    table.rows.push_back({comparison.methods[m]});
    if (with_failures) {
      table.rows[m].push_back(std::to_string(comparison.ids.size()));
      table.rows[m].push_back(std::to_string(failures(comparison, m)));
    }
  }
  for (const MetricInfo* metric : metrics) {
    const std::vector<int> rank = ranks(comparison, *metric);
    for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
      const Summary summary = summarize_metric(comparison, m, metric->key).summary;
      std::string cell = summary.n == 0 ? "–" : anigen::fixed(summary.mean, table_digits(*metric));
      const std::size_t told = with_failures ? failures(comparison, m) : 0;
      if (summary.n > 0 && summary.n + told < comparison.ids.size()) cell += " (n " + std::to_string(summary.n) + ")";
      if (rank[m] == 1) cell = "**" + cell + "**";
      if (rank[m] == 2) cell = "_" + cell + "_";
      table.rows[m].push_back(cell);
    }
  }
  return table;
}

anigen::Table metric_summary_table(const Comparison& comparison, std::size_t method) {
  anigen::Table table{{"metric", "key", "unit", "mean", "median", "std", "95 % of the mean", "assets"}, {}};
  for (const MetricInfo* metric : present_metrics(comparison, false)) {
    const MetricSummary summary = summarize_metric(comparison, method, metric->key);
    const std::size_t n = summary.summary.n;
    const auto cell = [&](double value) { return n == 0 ? "–" : anigen::fixed(value, table_digits(*metric)); };
    table.rows.push_back({column_head(*metric), metric->key, metric->unit, cell(summary.summary.mean),
                          cell(summary.summary.median), cell(summary.summary.std),
                          n == 0 ? "–" : cell(summary.interval.low) + " – " + cell(summary.interval.high),
                          std::to_string(n)});
  }
  return table;
}

anigen::Table pairing_table(const Comparison& comparison) {
  constexpr std::size_t kNamed = 5;
  const auto counted = [&](const std::vector<std::string>& names) {
    std::string text = std::to_string(names.size());
    for (std::size_t i = 0; i < std::min(kNamed, names.size()); ++i) text += (i == 0 ? ": " : ", ") + names[i];
    return text + (names.size() > kNamed ? ", …" : "");
  };
  anigen::Table table{{"method", "ground truths", "paired", "without a prediction", "unused predictions"}, {}};
  for (std::size_t m = 0; m < comparison.pairing.size(); ++m) {
    const Pairing& pairing = comparison.pairing[m];
    table.rows.push_back({comparison.methods[m], std::to_string(pairing.paired + pairing.missing.size()),
                          std::to_string(pairing.paired), counted(pairing.missing), counted(pairing.unused)});
  }
  return table;
}

anigen::Table reason_table(const Comparison& comparison) {
  anigen::Table table{{"method", "what", "reason", "assets"}, {}};
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    for (const PairResult& result : comparison.results[m]) {
      if (!result.failure.empty()) table.rows.push_back({comparison.methods[m], result.id, result.failure, "1"});
    }
    // Metrics that miss for the same reason share a line.
    std::map<std::string, std::map<std::string, std::size_t>> by_reason;
    for (const PairResult& result : comparison.results[m]) {
      for (const auto& [key, reason] : result.not_computed) ++by_reason[reason][key];
    }
    for (const auto& [reason, keys] : by_reason) {
      std::string what;
      std::size_t most = 0;
      for (const auto& [key, count] : keys) {
        what += (what.empty() ? "" : ", ") + key;
        most = std::max(most, count);
      }
      table.rows.push_back({comparison.methods[m], what, reason, std::to_string(most)});
    }
  }
  return table;
}

std::string transport_text(const Comparison& comparison) {
  const Json solver = comparison.settings.value("transport", Json::object());
  if (solver.value("solver", "exact") == "exact") return "";
  return "W and GW by Sinkhorn iterations; epsilon " + solver.at("epsilon_wasserstein").dump() + " and " +
         solver.at("epsilon_gromov_wasserstein").dump() + " of the largest squared distance.";
}

std::string to_markdown(const Comparison& comparison) {
  std::string text = "# " + std::to_string(comparison.ids.size()) + " ground truths\n\n" +
                     to_markdown(method_table(comparison, present_metrics(comparison, true)));
  if (comparison.methods.size() > 1)
    text +=
        "\nBest in bold, second best in italics; methods with values on different assets, or measured in different "
        "ways, are not ranked.\n";
  const std::string transport = transport_text(comparison);
  if (!transport.empty()) text += "\n" + transport + "\n";
  if (const auto skeletons = by_skeleton(comparison))
    add_section(text, "Every skeleton once: mean ± half of the 95 % interval over skeletons",
                skeleton_mean_table(*skeletons, comparison));
  add_section(text, "Pairs", pairing_table(comparison));
  add_section(text, "Differences to " + comparison.methods[0], difference_table(comparison));
  for (std::size_t m = 0; m < comparison.methods.size(); ++m)
    add_section(text, "All metrics, " + comparison.methods[m], metric_summary_table(comparison, m));
  add_section(text, "Not computed", reason_table(comparison));
  return text;
}

std::string to_latex(const Comparison& comparison) {
  const anigen::Table table = method_table(comparison, present_metrics(comparison, true), /*with_failures=*/false);
  const std::string transport = transport_text(comparison);
  return (transport.empty() ? "" : "% " + transport + "\n") + to_latex(table);
}

std::string file_name(const std::string& text) {
  std::string name;
  for (const char c : text.substr(0, 60))
    name += std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' ? c : '_';
  char hash[20];
  std::snprintf(hash, sizeof hash, "-%08x", static_cast<unsigned>(stable_hash(text)));
  return name + hash;
}

Comparison run_comparison(const std::vector<ComparedMethod>& methods, const ComparisonRun& run) {
  if (methods.empty() || methods[0].pairs.empty()) throw InputError("", "", "there is not one pair to evaluate");
  if (static_cast<bool>(run.perceptual.lpips) == run.settings.lpips.is_null() ||
      static_cast<bool>(run.perceptual.encoder) == run.settings.image_encoder.is_null())
    throw Error("a perceptual distance and its description belong together: saved results are told apart by it");
  if ((run.categories == nullptr) != run.settings.categories.is_null())
    throw Error("references of categories and their description belong together: saved results are told apart by it");
  if ((run.motion == nullptr) != run.settings.motion.is_null())
    throw Error("a motion and its description belong together: saved results are told apart by it");
  tell_of_other_code(methods, run);
  Comparison comparison;
  comparison.seed = run.settings.seed;
  for (const PairPlan& pair : methods[0].pairs) comparison.ids.push_back(pair.id);

  struct Work {
    std::size_t method, row;
    const PairPlan* pair;
  };
  std::vector<Work> work;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    comparison.methods.push_back(methods[m].label);
    comparison.results.emplace_back(comparison.ids.size());
    std::map<std::string, const PairPlan*> by_id;
    for (const PairPlan& pair : methods[m].pairs) by_id[pair.id] = &pair;
    for (std::size_t i = 0; i < comparison.ids.size(); ++i) {
      const auto found = by_id.find(comparison.ids[i]);
      if (found == by_id.end()) {
        comparison.results[m][i].id = comparison.ids[i];
        comparison.results[m][i].failure = "its list of pairs has no " + comparison.ids[i];
        continue;
      }
      work.push_back({m, i, found->second});
    }
  }
  // Pairs of one ground truth run one after the other, so that its file is still in the disk cache.
  std::stable_sort(work.begin(), work.end(), [](const Work& a, const Work& b) { return a.row < b.row; });

  std::vector<std::string> names;
  for (const Work& item : work) names.push_back(methods[item.method].label + "/" + item.pair->id);
  const LeaseFolder leases(run.cache / kLeases);
  Progress progress("evaluating", work.size(), "pairs");
  std::atomic<std::size_t> evaluated{0};
  // A pair done elsewhere is noticed when its shapes are read, which is for its turn; none counts as done here.
  work_together(
      leases, names, [](std::size_t) { return false; },
      [&](const std::vector<std::size_t>& pieces, const Claim& claim) {
        parallel_for(pieces.size(), [&](std::size_t p) {
          if (interrupt_requested()) return;
          const std::optional<Lease> lease = claim(pieces[p]);
          if (!lease) return;
          const Work& item = work[pieces[p]];
          comparison.results[item.method][item.row] = evaluate(*item.pair, methods[item.method], run);
          // Embree's aligned blocks leave holes in glibc's heap that it does not fill again: 0.4 MB a pair.
          if (++evaluated % kPairsPerRelease == 0) release_freed_memory();
          progress.advance();
        });
      });
  progress.finish();
  throw_if_interrupted();
  leases.remove_left();
  return comparison;
}

}  // namespace anigen::eval
