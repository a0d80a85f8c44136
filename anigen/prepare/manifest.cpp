#include "anigen/prepare/manifest.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <numeric>
#include <optional>
#include <sstream>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/core/table.h"
#include "anigen/prepare/run.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

/// @return nothing unless the whole text is a number
std::optional<std::size_t> number(const std::string& text) {
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

/// Files of the run's folder whose names begin and end like this, by name.
std::vector<fs::path> run_files(const fs::path& out, const std::string& begin, const std::string& end) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator entry(run_folder(out), error), last; !error && entry != last; entry.increment(error)) {
    const fs::path name = entry->path().filename();
    if (name.string().rfind(begin, 0) == 0 && name.extension() == end &&
        name.string().find(".tmp-") == std::string::npos)
      files.push_back(entry->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Opens a log that only this process appends to. @throws Error when it cannot be written
std::FILE* open_log(const fs::path& file) {
  std::FILE* stream = std::fopen(file.c_str(), "ae");
  if (stream == nullptr) throw Error(file.string() + ": cannot open: " + std::strerror(errno));
  return stream;
}

double megabytes(std::uint64_t bytes) { return static_cast<double>(bytes) / 1048576.0; }

struct Figures {
  double total = 0, mean = 0, median = 0, p95 = 0;
};

Figures figures(std::vector<double> seconds) {
  if (seconds.empty()) return {};
  std::sort(seconds.begin(), seconds.end());
  const double n = static_cast<double>(seconds.size());
  const auto at = [&](double share) { return seconds[static_cast<std::size_t>(share * (n - 1.0) + 0.5)]; };
  const double total = std::accumulate(seconds.begin(), seconds.end(), 0.0);
  return {total, total / n, at(0.5), at(0.95)};
}

bool is_number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return !text.empty() && end == text.c_str() + text.size() && std::isfinite(value);
}

std::map<std::string, std::string> read_scores(const std::filesystem::path& dataset) {
  std::map<std::string, std::string> scores;
  try {
    const CsvTable table = read_csv(dataset / "metadata.csv");
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
      const std::string& score = table.cell(row, "aesthetic_score");
      if (is_number(score)) scores[table.cell(row, "sha256")] = score;
    }
  } catch (const InputError&) {
    scores.clear();  // whoever reads the assets themselves says what is wrong there
  }
  return scores;
}

constexpr int kManifestFormat = 1;

Json header(const Manifest& manifest) {
  return {{"format", kManifestFormat},
          {"shard", manifest.shard.index},
          {"shards", manifest.shard.count},
          {"sources", manifest.sources},
          {"sources_digest", manifest.sources_digest},
          {"settings", manifest.settings}};
}

void read_header(const Json& json, Manifest& manifest) {
  if (json.at("format").get<int>() != kManifestFormat) throw InputError("", "", "written by another version");
  json.at("shard").get_to(manifest.shard.index);
  json.at("shards").get_to(manifest.shard.count);
  json.at("sources").get_to(manifest.sources);
  json.at("sources_digest").get_to(manifest.sources_digest);
  manifest.settings = json.at("settings");
}

Manifest parse_manifest(const fs::path& file, bool only_header) {
  std::istringstream lines(read_file(file));
  Manifest manifest;
  std::string line;
  for (std::size_t number = 1; std::getline(lines, line) && (number == 1 || !only_header); ++number) {
    try {
      const Json json = parse_json(line, file.string());
      if (number == 1) {
        read_header(json, manifest);
      } else {
        manifest.entries.push_back(json.get<ManifestEntry>());
      }
    } catch (const std::exception& error) {
      throw InputError(file.string(), "line " + std::to_string(number),
                       std::string("damaged; run this shard again (") + error.what() + ")");
    }
  }
  return manifest;
}

}  // namespace

Shard parse_shard(const std::string& text) {
  const std::size_t slash = text.find('/');
  if (slash != std::string::npos) {
    const auto index = number(text.substr(0, slash)), count = number(text.substr(slash + 1));
    if (index && count && *index < *count) return {*index, *count};
  }
  throw InputError("", "--shard", "must be i/n with 0 <= i < n, got \"" + text + "\"");
}

std::string failure_line(const AssetSource& source, const StepFailure& failure) {
  Json json = {{"source", source.file_identifier}};
  json.update(Json(failure));
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

FailureLog::FailureLog(const fs::path& out, const Shard& shard)
    : out_(out),
      name_("failures-" + shard.name()),
      file_(run_folder(out) / (name_ + "-" + process_number() + ".jsonl")),
      stream_(open_log(file_)) {}

FailureLog::~FailureLog() {
  std::fclose(stream_);
  std::error_code error;
  if (count_ == 0) fs::remove(file_, error);
}

void FailureLog::add(const AssetSource& source, const StepFailure& failure) {
  ++count_;
  std::fputs((failure_line(source, failure) + "\n").c_str(), stream_);
  std::fflush(stream_);
}

void FailureLog::finish(const std::vector<ManifestEntry>& entries) {
  std::string text;
  for (const ManifestEntry& entry : entries) {
    for (const StepFailure& failure : entry.failures) text += failure_line(entry.source, failure) + "\n";
  }
  write_file_atomically(run_folder(out_) / (name_ + ".jsonl"), text);
  for (const fs::path& file : run_files(out_, name_ + "-", ".jsonl")) {
    std::error_code ignored;
    fs::remove(file, ignored);
  }
}

KnownFailures FailureLog::read(const fs::path& out) {
  KnownFailures known;
  for (const fs::path& file : run_files(out, "failures-", ".jsonl")) {
    std::string text;
    try {
      text = read_file(file);
    } catch (const InputError&) {
      continue;  // whoever finishes a run puts them together
    }
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      if (line.empty()) continue;
      try {
        const Json json = parse_json(line, file.string());
        known[json.at("source").get<std::string>()].push_back(json.get<StepFailure>());
      } catch (const std::exception&) {
        continue;  // cut off by a kill: that step is tried again
      }
    }
  }
  return known;
}

TimingLog::TimingLog(const std::filesystem::path& out, const Shard& shard) {
  stream_ = open_log(run_folder(out) / ("timings-" + shard.name() + "-" + process_number() + ".csv"));
  std::fseek(stream_, 0, SEEK_END);
  if (std::ftell(stream_) == 0) std::fputs("id,variant,step,seconds,peak_mb\n", stream_);
}

TimingLog::~TimingLog() { std::fclose(stream_); }

void TimingLog::add(const SourceOutcome& outcome) {
  for (const AssetOutcome& asset : outcome.assets) {
    for (const StepTiming& timing : asset.timings) {
      std::fprintf(stream_, "%s,%zu,%s,%.4f,%.1f\n", asset.id.c_str(), asset.variant, timing.step.c_str(),
                   timing.seconds, megabytes(timing.peak_bytes));
      StepCost& cost = costs_[timing.step];
      cost.seconds.push_back(timing.seconds);
      cost.peak_bytes = std::max(cost.peak_bytes, timing.peak_bytes);
    }
  }
  std::fflush(stream_);
}

std::string to_text(const std::map<std::string, StepCost>& costs) {
  if (costs.empty()) return "";
  std::string text = "step                        assets    mean s  median s    95 % s   total s   peak MB\n";
  for (const auto& [step, cost] : costs) {
    const Figures f = figures(cost.seconds);
    char line[160];
    std::snprintf(line, sizeof line, "%-26s %7zu %9.3f %9.3f %9.3f %9.1f %9.0f\n", step.c_str(), cost.seconds.size(),
                  f.mean, f.median, f.p95, f.total, megabytes(cost.peak_bytes));
    text += line;
  }
  return text;
}

Json to_json(const std::map<std::string, StepCost>& costs) {
  Json json = Json::object();
  for (const auto& [step, cost] : costs) {
    const Figures f = figures(cost.seconds);
    json[step] = {{"assets", cost.seconds.size()},
                  {"mean_s", f.mean},
                  {"median_s", f.median},
                  {"p95_s", f.p95},
                  {"total_s", f.total},
                  {"peak_mb", megabytes(cost.peak_bytes)}};
  }
  return json;
}

std::string SourceScores::of(const AssetSource& source) {
  if (source.procedural() || source.format != io::RigFormat::kDataset) return "";
  auto found = by_dataset_.find(source.file);
  if (found == by_dataset_.end()) found = by_dataset_.emplace(source.file, read_scores(source.file)).first;
  const auto score = found->second.find(source.key);
  return score == found->second.end() ? "" : score->second;
}

fs::path manifest_path(const fs::path& out, const Shard& shard) {
  return run_folder(out) / ("sources-" + shard.name() + ".jsonl");
}

void write_manifest(const fs::path& out, const Manifest& manifest) {
  std::string text = header(manifest).dump() + "\n";
  for (const ManifestEntry& entry : manifest.entries) text += Json(entry).dump() + "\n";
  write_file_atomically(manifest_path(out, manifest.shard), text);
}

void remove_other_manifests(const fs::path& out, const Manifest& of_this_run) {
  for (const fs::path& file : run_files(out, "sources-", ".jsonl")) {
    bool keep = false;
    try {
      const Manifest other = parse_manifest(file, true);
      keep = other.same_run(of_this_run) && !(other.shard == of_this_run.shard);
    } catch (const InputError&) {  // damaged
    }
    if (!keep) remove_lastingly(file);
  }
}

std::vector<Manifest> read_manifests(const fs::path& out) {
  std::vector<Manifest> manifests;
  for (const fs::path& file : run_files(out, "sources-", ".jsonl")) manifests.push_back(parse_manifest(file, false));
  if (manifests.empty()) throw InputError(out.string(), "", "no finished run to merge: run/ holds no sources-*.jsonl");
  std::sort(manifests.begin(), manifests.end(),
            [](const Manifest& a, const Manifest& b) { return a.shard.index < b.shard.index; });
  const Shard& first = manifests[0].shard;
  std::string missing;
  std::size_t k = 0;
  for (std::size_t i = 0; i < first.count; ++i) {
    if (k < manifests.size() && manifests[k].shard.index == i) {
      if (!manifests[k].same_run(manifests[0])) {
        throw InputError(out.string(), "",
                         "shards " + first.name() + " and " + manifests[k].shard.name() +
                             " were run on other sources or with other options: run them alike");
      }
      ++k;
    } else {
      missing += " " + std::to_string(i);
    }
  }
  if (!missing.empty()) {
    throw InputError(out.string(), "",
                     "these of " + std::to_string(first.count) + " shards have not finished:" + missing);
  }
  return manifests;
}

}  // namespace anigen::prepare
