#include "anigen/prepare/run/manifest.h"

#include <algorithm>
#include <string_view>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/prepare/run/run_lock.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

constexpr int kFormat = 1;

Json to_json(const ManifestEntry& entry) {
  Json failures = Json::array();
  for (const StepFailure& failure : entry.failures) failures.push_back(prepare::to_json(failure));
  return {{"number", entry.number},
          {"source", prepare::to_json(entry.source)},
          {"id", entry.id},
          {"aesthetic_score", entry.aesthetic_score},
          {"failures", failures}};
}

ManifestEntry manifest_entry(const Json& json) {
  ManifestEntry entry;
  json.at("number").get_to(entry.number);
  entry.source = asset_source_from_json(json.at("source"));
  json.at("id").get_to(entry.id);
  json.at("aesthetic_score").get_to(entry.aesthetic_score);
  for (const Json& failure : json.at("failures")) entry.failures.push_back(step_failure_from_json(failure));
  return entry;
}

Json header(const Manifest& manifest) {
  return {{"format", kFormat},
          {"shard", manifest.shard.index},
          {"shards", manifest.shard.count},
          {"sources", manifest.sources},
          {"sources_digest", manifest.sources_digest},
          {"settings", manifest.settings}};
}

void read_header(const Json& json, Manifest& manifest) {
  if (json.at("format").get<int>() != kFormat) throw InputError("", "", "written by another version");
  json.at("shard").get_to(manifest.shard.index);
  json.at("shards").get_to(manifest.shard.count);
  json.at("sources").get_to(manifest.sources);
  json.at("sources_digest").get_to(manifest.sources_digest);
  manifest.settings = json.at("settings");
}

std::vector<fs::path> manifest_files(const fs::path& out) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator entry(run_folder(out), error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.rfind("sources-", 0) == 0 && entry->path().extension() == ".jsonl" &&
        name.find(".tmp-") == std::string::npos) {
      files.push_back(entry->path());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Calls use(line, number from 1) for the lines of a text.
template <typename Use>
void each_line(std::string_view text, Use use) {
  for (std::size_t number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    use(text.substr(0, end), number);
    text.remove_prefix(std::min(end + 1, text.size()));
  }
}

Manifest parse_manifest(const fs::path& file, bool only_header) {
  const std::string text = read_file(file);
  Manifest manifest;
  each_line(text, [&](std::string_view line, std::size_t number) {
    if (only_header && number > 1) return;
    try {
      const Json json = parse_json(line, file.string());
      if (number == 1) {
        read_header(json, manifest);
      } else {
        manifest.entries.push_back(manifest_entry(json));
      }
    } catch (const std::exception& error) {
      throw InputError(file.string(), "line " + std::to_string(number),
                       std::string("damaged; run this shard again (") + error.what() + ")");
    }
  });
  return manifest;
}

}  // namespace

fs::path manifest_path(const fs::path& out, const Shard& shard) {
  return run_folder(out) / ("sources-" + shard.name() + ".jsonl");
}

void write_manifest(const fs::path& out, const Manifest& manifest) {
  std::string text = header(manifest).dump() + "\n";
  for (const ManifestEntry& entry : manifest.entries) text += to_json(entry).dump() + "\n";
  write_file_atomically(manifest_path(out, manifest.shard), text);
}

Manifest read_manifest(const fs::path& file) { return parse_manifest(file, false); }

void remove_other_manifests(const fs::path& out, const Manifest& of_this_run) {
  for (const fs::path& file : manifest_files(out)) {
    bool keep = false;
    try {
      const Manifest other = parse_manifest(file, true);
      keep = other.same_run(of_this_run) && !(other.shard == of_this_run.shard);
    } catch (const InputError&) {
      keep = false;
    }
    std::error_code ignored;
    if (!keep) fs::remove(file, ignored);
  }
}

std::vector<Manifest> read_manifests(const fs::path& out) {
  std::vector<Manifest> manifests;
  for (const fs::path& file : manifest_files(out)) manifests.push_back(read_manifest(file));
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
