#include "anigen/generate/latent_records.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/io/arrays/npz.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSaveEvery = 256;

constexpr char kShape[] = "feats", kSkeleton[] = "feats_skl";

/// "runs/ss_dae/" is called ss_dae, and a link as it is called itself.
std::string last_part(const fs::path& run) {
  std::error_code error;
  const fs::path whole = fs::absolute(run, error).lexically_normal();
  return (whole.has_filename() ? whole : whole.parent_path()).filename().string();
}

void warn_of_constant_channels(const LatentStatistics& statistics, const char* name) {
  const std::string channels = joined(statistics.constant_channels());
  if (channels.empty()) return;
  log::warn("{}: channels {} have the same value in all latents: such statistics cannot normalise them", name,
            channels);
}

/// Arguments of the dataset of stage 5; a channel that does not vary keeps deviation 1.
Json normalization(const LatentStatistics& shape, const LatentStatistics& skeleton, std::size_t normalized) {
  std::vector<float> mean = shape.mean(), deviation = shape.deviation();
  std::fill(mean.begin() + static_cast<std::ptrdiff_t>(std::min(normalized, mean.size())), mean.end(), 0.0f);
  std::fill(deviation.begin() + static_cast<std::ptrdiff_t>(std::min(normalized, deviation.size())), deviation.end(),
            1.0f);
  for (const std::size_t channel : shape.constant_channels()) deviation[channel] = 1.0f;
  const std::size_t channels = skeleton.mean().size();
  return {{"mean", mean},
          {"std", deviation},
          {"mean_skl", std::vector<float>(channels, 0.0f)},
          {"std_skl", std::vector<float>(channels, 1.0f)}};
}

/// @return null when there is none, or it is damaged
Json read_or_null(const fs::path& file) {
  try {
    return read_json(file);
  } catch (const InputError&) {
    return nullptr;
  }
}

bool is_of(const Json& run, const Json& encoder) {
  return run.is_object() && run.contains("encoder") && run.at("encoder") == encoder;
}

void write(const fs::path& file, const Json& json) {
  write_file_atomically(file, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

// `<prefix>_mean` and `<prefix>_std`, as a dataset's `normalization` argument wants them.
void append_arrays(io::NamedArrays& arrays, const std::string& prefix, const LatentStatistics& statistics) {
  const std::vector<float> mean = statistics.mean(), deviation = statistics.deviation();
  const auto channels = static_cast<std::int64_t>(mean.size());
  arrays.emplace_back(prefix + "_mean", io::NdArray::from(mean, {channels}));
  arrays.emplace_back(prefix + "_std", io::NdArray::from(deviation, {channels}));
}

}  // namespace

LatentManifest::LatentManifest(const fs::path& folder, std::string encoder)
    : file_(folder / "encoded.json"), encoder_(std::move(encoder)) {
  std::error_code error;
  if (!fs::exists(file_, error)) return;
  try {
    const Json json = read_json(file_);
    if (json.at("encoder") != encoder_) return;
    for (const auto& [id, asset] : json.at("assets").items()) {
      if (asset.is_string()) {  // as programs wrote it that recorded no commit
        entries_[id] = {asset.get<std::string>(), ""};
      } else {
        entries_[id] = {asset.at("inputs").get<std::string>(), asset.at("commit").get<std::string>()};
      }
    }
  } catch (const std::exception& problem) {
    log::warn("{}: {}; everything is encoded again", file_.string(), problem.what());
    entries_.clear();
  }
}

LatentManifest::~LatentManifest() {
  if (unsaved_ == 0) return;
  try {
    save();
  } catch (const std::exception& problem) {
    log::warn("{}; the latents of this run will be made again", problem.what());
  }
}

bool LatentManifest::up_to_date(const std::string& id, const std::string& inputs) const {
  const auto entry = entries_.find(id);
  return entry != entries_.end() && entry->second.inputs == inputs;
}

std::string LatentManifest::commit_of(const std::string& id) const {
  const auto entry = entries_.find(id);
  return entry == entries_.end() ? "" : entry->second.commit;
}

void LatentManifest::forget(const std::vector<std::string>& ids) {
  for (const std::string& id : ids) entries_.erase(id);
  save();
}

void LatentManifest::add(const std::string& id, const std::string& inputs, const std::string& commit) {
  entries_[id] = {inputs, commit};
  if (++unsaved_ >= kSaveEvery) save();
}

void LatentManifest::save() {
  Json assets = Json::object();
  for (const auto& [id, entry] : entries_) assets[id] = {{"inputs", entry.inputs}, {"commit", entry.commit}};
  const Json json = {{"encoder", encoder_}, {"assets", assets}};
  write_file_atomically(file_, json.dump(1) + "\n");
  unsaved_ = 0;
}

std::string fingerprint_of_files(const std::vector<fs::path>& files) {
  Sha256 digest;
  for (const fs::path& file : files) {
    const std::string bytes = read_file(file);
    digest.update(std::to_string(bytes.size()) + ":");  // so that bytes cannot move from one file to the next
    digest.update(bytes);
  }
  return digest.finish();
}

LatentMoments moments_of(const std::vector<float>& values, std::size_t channels, const std::string& name) {
  if (channels == 0 || values.empty() || values.size() % channels != 0)
    throw InputError(name, "", "its latent is empty, or has a part of a channel");
  const std::size_t count = values.size() / channels;
  LatentMoments moments;
  for (std::size_t c = 0; c < channels; ++c) {
    double sum = 0.0, squares = 0.0;
    for (std::size_t i = c * count; i < (c + 1) * count; ++i) {
      const double value = values[i];
      sum += value;
      squares += value * value;
    }
    moments.mean.push_back(sum / static_cast<double>(count));
    moments.mean_square.push_back(squares / static_cast<double>(count));
  }
  return moments;
}

void LatentStatistics::add(const LatentMoments& moments, const std::string& name) {
  const std::size_t channels = moments.mean.size();
  if (assets_ == 0) {
    sum_.assign(channels, 0.0);
    sum_of_squares_.assign(channels, 0.0);
  }
  if (channels != sum_.size()) {
    throw InputError(
        name, "",
        "its latent has " + std::to_string(channels) + " channels, others have " + std::to_string(sum_.size()));
  }
  for (std::size_t c = 0; c < channels; ++c) {
    sum_[c] += moments.mean[c];
    sum_of_squares_[c] += moments.mean_square[c];
  }
  ++assets_;
}

std::vector<float> LatentStatistics::mean() const {
  std::vector<float> result;
  for (const double sum : sum_) result.push_back(static_cast<float>(sum / static_cast<double>(assets_)));
  return result;
}

std::vector<float> LatentStatistics::deviation() const {
  std::vector<float> result;
  for (std::size_t c = 0; c < sum_.size(); ++c) {
    const auto n = static_cast<double>(assets_);
    const double mean = sum_[c] / n, variance = sum_of_squares_[c] / n - mean * mean;
    result.push_back(static_cast<float>(std::sqrt(std::max(variance, 0.0))));
  }
  return result;
}

std::vector<std::size_t> LatentStatistics::constant_channels() const {
  // E[x²] − E[x]² of equal values is not zero but some 1e-16 E[x]².
  constexpr float kRounding = 1e-6f;
  const std::vector<float> means = mean(), deviations = deviation();
  std::vector<std::size_t> channels;
  for (std::size_t c = 0; c < means.size(); ++c) {
    if (deviations[c] <= kRounding * std::abs(means[c])) channels.push_back(c);
  }
  return channels;
}

Json to_json(const LatentStatistics& statistics) {
  return {{"mean", statistics.mean()}, {"std", statistics.deviation()}};
}

LatentFolder::LatentFolder(const fs::path& data, const std::string& name, const fs::path& run, LatentKind kind)
    : kind_(kind),
      name_(name.empty() ? last_part(run) : name),
      path_(data / (kind == LatentKind::kStructure ? "ss_latents" : "latents") / name_) {
  const bool plain = !name_.empty() && name_.front() != '.' && std::all_of(name_.begin(), name_.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' ||
           c == '.';
  });
  if (!plain) {
    throw InputError("", "--latents-name",
                     "'" + name_ + "': a name of latents has letters, digits, '_', '-' and '.' only");
  }
}

fs::path LatentFolder::statistics(const char* extension) const {
  return path_.parent_path() / (name_ + "_statistics" + extension);
}

void LatentFolder::write_statistics(const LatentStatistics& shape, const LatentStatistics& skeleton,
                                    std::size_t normalized) const {
  warn_of_constant_channels(shape, kShape);
  warn_of_constant_channels(skeleton, kSkeleton);
  io::NamedArrays arrays;
  append_arrays(arrays, kShape, shape);
  append_arrays(arrays, kSkeleton, skeleton);
  io::write_npz(statistics(".npz"), arrays);
  Json json = {{"assets", shape.assets()}, {kShape, to_json(shape)}, {kSkeleton, to_json(skeleton)}};
  if (kind_ == LatentKind::kStructured) json["normalization"] = normalization(shape, skeleton, normalized);
  write_file_atomically(statistics(".json"), json.dump(2) + "\n");
}

void LatentFolder::remove_statistics() const {
  for (const char* extension : {".npz", ".json"}) remove_lastingly(statistics(extension));
}

LatentOutcomes::LatentOutcomes(const fs::path& data, const std::string& column)
    : folder_(dataset_lock_file(data).parent_path() / ("encode-" + column)) {}

std::map<std::string, LatentOutcome> LatentOutcomes::encoded_by(const Json& encoder) const {
  std::map<std::string, LatentOutcome> encoded;
  if (!is_of(read_or_null(run_file()), encoder)) return encoded;
  std::error_code error;
  for (fs::directory_iterator entry(folder_ / "assets", error), end; !error && entry != end; entry.increment(error)) {
    const std::string id = entry->path().stem().string();
    if (id.find(".tmp-") != std::string::npos) continue;  // what a killed process left
    const std::optional<LatentOutcome> outcome = read(id);
    if (outcome && outcome->failure.empty() && !outcome->inputs.empty()) encoded[id] = *outcome;
  }
  return encoded;
}

void LatentOutcomes::begin(const Json& encoder, const std::set<std::string>& kept) const {
  remove_lastingly(folder_);
  generate::write(run_file(), {{"encoder", encoder}, {"kept", kept}, {"commit", commit()}});
}

bool LatentOutcomes::join(const Json& encoder, std::set<std::string>& kept) const {
  const Json run = read_or_null(run_file());
  if (!is_of(run, encoder) || run.value("commit", Json()) != commit()) return false;
  kept = run.at("kept").get<std::set<std::string>>();
  return true;
}

std::optional<LatentOutcome> LatentOutcomes::read(const std::string& id) const {
  Json json = read_or_null(file(id));
  try {
    json.emplace("commit", "");  // programs that recorded none left it out
    return json.get<LatentOutcome>();
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

void LatentOutcomes::write(const std::string& id, const LatentOutcome& outcome) const {
  generate::write(file(id), outcome);
}

bool LatentOutcomes::concluded() const {
  std::error_code error;
  return fs::exists(folder_ / "concluded", error);
}

void LatentOutcomes::set_concluded() const { write_file_atomically(folder_ / "concluded", ""); }

}  // namespace anigen::generate
