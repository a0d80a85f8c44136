#include "anigen/prepare/run/failure_log.h"

#include <cerrno>
#include <cstring>
#include <sstream>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/prepare/run/run_lock.h"

namespace anigen::prepare {

namespace fs = std::filesystem;

std::string failure_line(const AssetSource& source, const StepFailure& failure) {
  Json json = {{"source", source.file_identifier}};
  json.update(to_json(failure));
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

FailureLog::FailureLog(const fs::path& out, const Shard& shard)
    : file_(run_folder(out) / ("failures-" + shard.name() + ".jsonl")) {
  stream_ = std::fopen(file_.c_str(), "ae");
  if (stream_ == nullptr) throw Error(file_.string() + ": cannot open: " + std::strerror(errno));
  // A kill may have cut the last line off; an empty line after it keeps the next one whole.
  std::fseek(stream_, 0, SEEK_END);
  if (std::ftell(stream_) > 0) std::fputc('\n', stream_);
}

FailureLog::~FailureLog() {
  if (stream_ != nullptr) std::fclose(stream_);
}

void FailureLog::add(const AssetSource& source, const StepFailure& failure) {
  ++count_;
  std::fputs((failure_line(source, failure) + "\n").c_str(), stream_);
  std::fflush(stream_);
}

void FailureLog::finish(const std::vector<std::pair<const AssetSource*, const StepFailure*>>& failures) {
  std::fclose(stream_);
  stream_ = nullptr;
  std::string text;
  for (const auto& [source, failure] : failures) text += failure_line(*source, *failure) + "\n";
  write_file_atomically(file_, text);
}

KnownFailures FailureLog::read(const fs::path& out) {
  KnownFailures known;
  std::error_code error;
  for (fs::directory_iterator entry(run_folder(out), error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.rfind("failures-", 0) != 0 || name.find(".tmp-") != std::string::npos) continue;
    std::istringstream lines(read_file(entry->path()));
    for (std::string line; std::getline(lines, line);) {
      if (line.empty()) continue;
      try {
        const Json json = parse_json(line, name);
        known[json.at("source").get<std::string>()].push_back(step_failure_from_json(json));
      } catch (const std::exception&) {
        continue;  // cut off by a kill: that step is tried again
      }
    }
  }
  return known;
}

}  // namespace anigen::prepare
