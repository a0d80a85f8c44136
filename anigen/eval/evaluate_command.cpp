#include "anigen/eval/evaluate_command.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/eval/comparison_report.h"
#include "anigen/eval/pairs.h"
#include "anigen/eval/pairs_csv.h"
#include "anigen/eval/protocol.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/metrics/motion.h"

namespace anigen::eval {

namespace {

namespace fs = std::filesystem;

struct Opened {
  std::vector<ComparedMethod> methods;
  std::shared_ptr<const io::ShapeSource> truth;  ///< of --dataset, where given
  std::vector<std::string> unused;
  std::vector<Pairing> pairing;
  Json described = Json::object();
};

ComparedMethod from_pairs(const std::string& label, const fs::path& csv, const EvaluationRequest& request,
                          std::vector<std::string>& unused) {
  PairedSources sources = read_pairs_csv(csv, {request.truth_axes}, {request.axes_of(label)});
  unused = sources.list.unused;
  return {label, std::move(sources.prediction), std::move(sources.truth), std::move(sources.list.pairs)};
}

/// True when a prediction or a split file calls something by a sha256: only then are the truths' contents worth
/// hashing.
bool asks_for_contents(const EvaluationRequest& request, const std::vector<ComparedMethod>& methods) {
  for (const ComparedMethod& method : methods) {
    const std::vector<std::string> ids = method.predictions->ids();
    if (std::any_of(ids.begin(), ids.end(), ends_in_sha256)) return true;
  }
  for (const std::vector<fs::path>* lists : {&request.splits, &request.category_splits}) {
    for (const fs::path& list : *lists) {
      for (const io::SplitLine& line : io::split_lines(list)) {
        if (ends_in_sha256(line.id)) return true;
      }
    }
  }
  return false;
}

/// Names left over on both sides, for the table. @param rows of the comparison
Pairing pairing_of(const std::vector<PairPlan>& pairs, const std::set<std::string>& rows,
                   std::vector<std::string> unused) {
  Pairing pairing;
  for (const PairPlan& pair : pairs) {
    if (rows.count(pair.id) == 0) continue;
    if (pair.prediction_id)
      ++pairing.paired;
    else
      pairing.missing.push_back(pair.id);
  }
  pairing.unused = std::move(unused);
  return pairing;
}

/// Every name in --pred-up is that of a prediction.
void require_named(const EvaluationRequest& request, const std::set<std::string>& labels) {
  for (const auto& [label, axes] : request.axes_of_methods) {
    if (labels.count(label) == 0)
      throw InputError("", "--pred-up", "no --pred is called '" + label + "'; there are " + joined(labels));
  }
}

/// True for files that say one thing, or are both missing.
bool equal_contents(const fs::path& one, const fs::path& other) {
  std::error_code error;
  if (one == other || fs::equivalent(one, other, error)) return true;
  const bool is_there = fs::is_regular_file(one, error);
  if (!is_there || !fs::is_regular_file(other, error)) return is_there == fs::is_regular_file(other, error);
  return fs::file_size(one, error) == fs::file_size(other, error) && read_file(one) == read_file(other);
}

/// Truths of two CSVs that have one id although their files differ: a row then compares methods on several assets.
void warn_of_other_truths(const ComparedMethod& first, const ComparedMethod& other) {
  std::map<std::string, std::string> truth_of_row;
  for (const PairPlan& pair : first.pairs) truth_of_row.emplace(pair.id, pair.truth_id);
  std::size_t count = 0;
  std::string example;
  for (const PairPlan& pair : other.pairs) {
    const auto found = truth_of_row.find(pair.id);
    if (found == truth_of_row.end()) continue;
    const std::vector<fs::path> a = first.truths->files(found->second), b = other.truths->files(pair.truth_id);
    // The last is the file itself, before it what it refers to.
    if (a.empty() || b.empty() || equal_contents(a.back(), b.back())) continue;
    if (++count == 1) example = pair.id + ": " + a.back().string() + ", " + b.back().string();
  }
  if (count > 0)
    log::warn("{} rows of {} have another ground truth than in {} under the same id, such as {}", count, other.label,
              first.label, example);
}

Opened open(const EvaluationRequest& request) {
  Opened opened;
  std::set<std::string> labels;
  std::vector<std::vector<std::string>> unused(request.predictions.size());
  for (std::size_t m = 0; m < request.predictions.size(); ++m) {
    const std::string& text = request.predictions[m];
    const auto [label, path] = named_path(text);
    if (!labels.insert(label).second)
      throw InputError(text, "", "two predictions are called '" + label + "': name them, as in --pred ours=FOLDER");
    if (path.extension() == ".csv") {
      opened.methods.push_back(from_pairs(label, path, request, unused[m]));
    } else {
      if (request.truth.empty())
        throw InputError(text, "", "needs --dataset with the ground truth, unless it is a CSV of pairs");
      opened.methods.push_back({label, io::open_source(path, {request.axes_of(label)}), nullptr, {}});
    }
    opened.described["predictions"][label] = opened.methods.back().predictions->describe();
  }
  require_named(request, labels);
  if (!request.truth.empty()) {
    opened.truth = io::open_source(request.truth, {request.truth_axes, asks_for_contents(request, opened.methods)});
    opened.described["ground_truth"] = opened.truth->describe();
    const std::vector<std::string> ids = io::select_ids(*opened.truth, request.splits, request.most);
    for (std::size_t m = 0; m < opened.methods.size(); ++m) {
      ComparedMethod& method = opened.methods[m];
      if (method.truths) continue;
      method.truths = opened.truth;
      PairList list = match_pairs(*opened.truth, *method.predictions, ids);
      method.pairs = std::move(list.pairs);
      unused[m] = std::move(list.unused);
    }
  }
  // Rows are those of the first method.
  std::set<std::string> rows;
  for (const PairPlan& pair : opened.methods[0].pairs) rows.insert(pair.id);
  for (std::size_t m = 1; m < opened.methods.size(); ++m) {
    const bool both_listed = opened.methods[0].truths != opened.truth && opened.methods[m].truths != opened.truth;
    if (both_listed) warn_of_other_truths(opened.methods[0], opened.methods[m]);
    for (const PairPlan& pair : opened.methods[m].pairs) {
      if (pair.prediction_id && rows.count(pair.id) == 0) unused[m].push_back(pair.id);
    }
  }
  for (std::size_t m = 0; m < opened.methods.size(); ++m) {
    for (const std::string& id : unused[m]) opened.unused.push_back(opened.methods[m].label + ": " + id);
    opened.pairing.push_back(pairing_of(opened.methods[m].pairs, rows, std::move(unused[m])));
  }
  return opened;
}

/// Results lie in --output under fixed names; pictures of motions replace whatever is in their folder.
void refuse_lossy_outputs(const EvaluationRequest& request, const Opened& opened) {
  std::vector<fs::path> outputs;
  for (const char* file : {"metrics.json", "metrics.csv", "table.md", "table.tex", "report.html", "protocol.md"})
    outputs.push_back(request.out / file);
  std::error_code error;
  for (fs::recursive_directory_iterator entry(request.out / "motion", error), end;
       request.motions_pictured > 0 && !error && entry != end; entry.increment(error))
    outputs.push_back(entry->path());
  refuse_to_overwrite(outputs, [&] {
    std::vector<fs::path> inputs = request.splits;
    inputs.insert(inputs.end(), request.category_splits.begin(), request.category_splits.end());
    inputs.push_back(request.motion.substr(0, request.motion.rfind('#')));
    inputs.emplace_back(request.motion);  // a file whose name holds a #
    for (const std::string& text : request.predictions) inputs.push_back(named_path(text).second);
    for (const ComparedMethod& method : opened.methods) {
      for (const PairPlan& pair : method.pairs) {
        for (fs::path& file : method.truths->files(pair.truth_id)) inputs.push_back(std::move(file));
        if (!pair.prediction_id) continue;
        for (fs::path& file : method.predictions->files(*pair.prediction_id)) inputs.push_back(std::move(file));
      }
    }
    return inputs;
  });
}

/// Order of the predictions; null unless the request asks for it.
std::unique_ptr<CategoryReferences> open_categories(const Opened& opened, const EvaluationRequest& request) {
  if (request.category_splits.empty()) return nullptr;
  if (!opened.truth) throw InputError("", "--category-split", "names shapes of the ground truth: it needs --dataset");
  if (!request.settings.wants("surface"))
    throw InputError("", "--category-split", "goes by surfaces: --metrics must have 'surface'");
  const std::vector<std::string> ids = io::select_ids(*opened.truth, request.category_splits);
  auto references = std::make_unique<CategoryReferences>(*opened.truth, ids, request.settings.seed);
  if (references->size() > 0) return references;
  log::warn("--category-split: the data set says of none of these shapes what kind it is; 'category' is left out");
  return nullptr;
}

/// Reads and aligns the shapes of a picture again: keeping all of them would take a data set's memory.
ComparedShapes shapes_of(const std::vector<ComparedMethod>& methods, const Comparison& comparison, std::size_t method,
                         std::size_t asset, const PairSettings& settings) {
  for (const PairPlan& pair : methods[method].pairs) {
    if (pair.id != comparison.ids[asset] || !pair.prediction_id) continue;
    return bring_together(methods[method].predictions->read(*pair.prediction_id),
                          methods[method].truths->read(pair.truth_id), settings);
  }
  throw InputError("", comparison.ids[asset], "has no prediction to show");
}

/// One asset of every method, in the truth's motion.
MotionStrip draw_motion(const std::vector<ComparedMethod>& methods, const Comparison& comparison, std::size_t asset,
                        const ComparisonRun& run, const fs::path& folder) {
  MotionStrip strip;
  strip.id = comparison.ids[asset];
  try {
    std::vector<MotionRow> rows;
    for (std::size_t m = 0; m < methods.size(); ++m) {
      rows.push_back({comparison.methods[m], std::nullopt});
      if (comparison.results[m][asset].failure.empty())
        rows.back().shapes = shapes_of(methods, comparison, m, asset, run.settings);
    }
    const std::vector<MovingRig> rigs = moving_rigs(rows, run.settings, run.motion);
    constexpr int kSize = 224;  // five beside each other fit on a page of the report
    strip.frames = motion_frames(rigs, kSize);
    write_motion(folder / file_name(strip.id), rigs, strip.frames);
  } catch (...) {
    strip.problem = failure_of_item();
  }
  return strip;
}

std::vector<MotionStrip> draw_motions(const std::vector<ComparedMethod>& methods, const Comparison& comparison,
                                      const EvaluationRequest& request, const ComparisonRun& run) {
  std::vector<MotionStrip> strips;
  if (request.motions_pictured == 0) return strips;
  std::vector<std::size_t> assets = worst_first(comparison, 0, request.worst_by);
  // An asset that the first method failed on may still have nothing to show: those come last.
  std::stable_partition(assets.begin(), assets.end(),
                        [&](std::size_t i) { return comparison.results[0][i].failure.empty(); });
  assets.resize(std::min(assets.size(), request.motions_pictured));
  for (const std::size_t asset : assets)
    strips.push_back(draw_motion(methods, comparison, asset, run, request.out / "motion"));
  return strips;
}

/// Number of accepted results by the other build of the program that made them.
Json other_commits(const Comparison& comparison) {
  std::map<std::string, std::size_t> counts;
  for (const std::vector<PairResult>& method : comparison.results) {
    for (const PairResult& result : method) {
      if (result.failure.empty() && result.commit != commit())
        ++counts[result.commit.empty() ? "none recorded" : result.commit];
    }
  }
  return counts;
}

void write(const Comparison& comparison, const EvaluationRequest& request, const std::vector<ComparedMethod>& methods,
           const ComparisonRun& run) {
  write_file_atomically(request.out / "metrics.json", to_json(comparison).dump(2) + "\n");
  write_file_atomically(request.out / "metrics.csv", to_csv(to_csv_table(comparison)));
  write_file_atomically(request.out / "table.md", to_markdown(comparison));
  write_file_atomically(request.out / "table.tex", to_latex(comparison));
  if (!request.protocol.empty())
    write_file_atomically(request.out / "protocol.md",
                          protocol_markdown(comparison, evaluation_protocol(request.protocol)) + "\n");
  std::vector<MotionStrip> motions = draw_motions(methods, comparison, request, run);
  if (!request.report) return;
  ComparisonReportOptions report;
  report.motions = std::move(motions);
  report.pictured = request.pictured;
  report.worst_by = request.worst_by;
  report.shapes = [&](std::size_t method, std::size_t asset) {
    return shapes_of(methods, comparison, method, asset, request.settings);
  };
  write_file_atomically(request.out / "report.html", comparison_report(comparison, report));
}

}  // namespace

io::Axes EvaluationRequest::axes_of(const std::string& method) const {
  const auto own = axes_of_methods.find(method);
  return own == axes_of_methods.end() ? prediction_axes : own->second;
}

void set_prediction_axes(const std::vector<std::string>& words, EvaluationRequest& request) {
  bool for_all = false;
  for (const std::string& word : words) {
    const std::size_t sign = word.rfind('=');
    const io::Axes axes = io::parse_axes(sign == std::string::npos ? word : word.substr(sign + 1));
    const bool is_new = sign == std::string::npos ? !std::exchange(for_all, true)
                                                  : request.axes_of_methods.emplace(word.substr(0, sign), axes).second;
    if (!is_new) throw InputError("", "--pred-up", "'" + word + "': the up axis of these predictions is given twice");
    if (sign == std::string::npos) request.prediction_axes = axes;
  }
}

std::pair<std::string, fs::path> named_path(const std::string& text) {
  const std::size_t sign = text.find('=');
  // A path may hold an equals sign, too; a name holds no separator.
  if (sign != std::string::npos && sign > 0 && text.find('/') > sign && sign + 1 < text.size())
    return {text.substr(0, sign), text.substr(sign + 1)};
  fs::path path = fs::path(text).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  const std::string label = fs::is_directory(path) ? path.filename().string() : path.stem().string();
  return {label.empty() ? "prediction" : label, text};
}

Comparison run_evaluation(const EvaluationRequest& request) {
  if (request.predictions.empty()) throw InputError("", "--pred", "nothing to evaluate");
  if (!request.protocol.empty()) {
    EvaluationRequest fixed = request;
    apply(evaluation_protocol(request.protocol), fixed.settings);
    if (!(to_json(fixed.settings) == to_json(request.settings)))
      throw InputError("", "--protocol", "the settings are not those of the protocol: apply() sets them");
  }
  check(request.settings);
  if (!request.worst_by.empty() && find_metric(request.worst_by) == nullptr)
    throw InputError("", request.worst_by, "no such metric; docs/metrics.md lists them");
  const Opened opened = open(request);
  refuse_lossy_outputs(request, opened);

  ComparisonRun run;
  const std::unique_ptr<CategoryReferences> categories = open_categories(opened, request);
  run.settings = request.settings;
  if (categories) run.settings.categories = categories->describe();
  run.categories = categories.get();
  metrics::MotionFile motion;
  if (!request.motion.empty()) {
    motion = metrics::read_motion(request.motion, request.settings.motion_frames);
    run.motion = &motion.motion;
    run.settings.motion = motion.described;
  }
  run.perceptual = request.perceptual;
  run.cache = request.out / "pairs";
  run.resume = request.resume;
  run.accept_other_code = request.accept_other_code;
  Comparison comparison = run_comparison(opened.methods, run);
  comparison.unused = opened.unused;
  comparison.pairing = opened.pairing;
  comparison.settings = to_json(run.settings);
  comparison.settings["made_by"] = made_by();
  const Json others = other_commits(comparison);
  if (!others.empty()) comparison.settings["results_of_other_commits"] = others;
  comparison.settings["sources"] = opened.described;
  comparison.settings["splits"] = request.splits;
  if (!request.protocol.empty()) comparison.settings["protocol"] = request.protocol;
  write(comparison, request, opened.methods, run);
  return comparison;
}

}  // namespace anigen::eval
