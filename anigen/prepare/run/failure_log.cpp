#include "anigen/prepare/run/failure_log.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <sstream>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/process_identity.h"
#include "anigen/prepare/run/run_lock.h"

namespace anigen::prepare {

namespace fs = std::filesystem;

namespace {

/// Logs whose names begin like this, by name.
std::vector<fs::path> log_files(const fs::path& out, const std::string& begin) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator entry(run_folder(out), error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.rfind(begin, 0) == 0 && name.find(".tmp-") == std::string::npos) files.push_back(entry->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

std::string failure_line(const AssetSource& source, const StepFailure& failure) {
  Json json = {{"source", source.file_identifier}};
  json.update(to_json(failure));
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

FailureLog::FailureLog(const fs::path& out, const Shard& shard)
    : out_(out),
      name_("failures-" + shard.name()),
      file_(run_folder(out) / (name_ + "-" + process_number() + ".jsonl")) {
  stream_ = std::fopen(file_.c_str(), "ae");
  if (stream_ == nullptr) throw Error(file_.string() + ": cannot open: " + std::strerror(errno));
}

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

void FailureLog::finish(const std::vector<std::pair<const AssetSource*, const StepFailure*>>& failures) {
  std::string text;
  for (const auto& [source, failure] : failures) text += failure_line(*source, *failure) + "\n";
  write_file_atomically(run_folder(out_) / (name_ + ".jsonl"), text);
  for (const fs::path& file : log_files(out_, name_ + "-")) {
    std::error_code ignored;
    fs::remove(file, ignored);
  }
}

KnownFailures FailureLog::read(const fs::path& out) {
  KnownFailures known;
  for (const fs::path& file : log_files(out, "failures-")) {
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
        known[json.at("source").get<std::string>()].push_back(step_failure_from_json(json));
      } catch (const std::exception&) {
        continue;  // cut off by a kill: that step is tried again
      }
    }
  }
  return known;
}

}  // namespace anigen::prepare
