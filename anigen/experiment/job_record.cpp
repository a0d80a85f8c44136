#include "anigen/experiment/job_record.h"

#include <algorithm>
#include <ctime>
#include <map>
#include <system_error>

#include "anigen/core/config_file.h"
#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

constexpr const char* kWords[] = {"begun", "done", "failed", "interrupted"};

JobRecord::State state_of(const std::string& word) {
  const auto found = std::find(std::begin(kWords), std::end(kWords), word);
  return static_cast<JobRecord::State>(found - std::begin(kWords));
}

/// A command without its program.
std::string arguments_of(const std::string& command) {
  const std::size_t space = command.find(' ');
  return space == std::string::npos ? "" : command.substr(space);
}

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

}  // namespace

const char* word_of(JobRecord::State state) { return kWords[static_cast<int>(state)]; }

fs::path record_file(const fs::path& out, const std::string& id) { return out / "records" / (id + ".json"); }
fs::path log_file(const fs::path& out, const std::string& id) { return out / "records" / (id + ".log"); }
fs::path worker_logs(const fs::path& out, const std::string& id) { return out / "records" / (id + ".workers"); }

fs::path run_lock_file(const fs::path& out) { return out / "locks" / "all"; }
fs::path job_lock_file(const fs::path& out, const std::string& id) { return out / "locks" / id; }

std::vector<std::string> recorded_jobs(const fs::path& out) {
  std::vector<std::string> ids;
  std::error_code error;
  if (!fs::is_directory(out / "records", error)) return ids;
  for (const auto& entry : fs::directory_iterator(out / "records")) {
    const std::string id = entry.path().stem().string();
    // Other names are records that are being written.
    if (entry.path().extension() == ".json" && is_job_id(id)) ids.push_back(id);
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

std::optional<JobRecord> read_record(const fs::path& out, const std::string& id) {
  const fs::path file = record_file(out, id);
  std::error_code error;
  if (!fs::exists(file, error)) return std::nullopt;
  const Json json = read_json(file);
  ConfigReader reader(json, file.string());
  JobRecord record;
  record.state = state_of(reader.choice("state", "begun", {std::begin(kWords), std::end(kWords)}));
  record.step = reader.text("step", "");
  record.key = reader.text("key", "");
  record.content = reader.text("content", "");
  record.command = reader.text("command", "");
  record.started = reader.text("started", "");
  record.finished = reader.text("finished", "");
  record.seconds = reader.number("seconds", 0, 0);
  record.expected_seconds = reader.number("expected_seconds", 0, 0.0);
  record.peak_bytes = static_cast<std::uint64_t>(reader.integer("peak_bytes", 0, 0));
  record.disk_bytes = static_cast<std::uint64_t>(reader.integer("disk_bytes", 0, 0));
  record.attempts = static_cast<int>(reader.integer("attempts", 0, 0, 1 << 20));
  record.status = static_cast<int>(reader.integer("status", 0, -256, 256));
  reader.finish();
  return record;
}

void write_record(const fs::path& out, const std::string& id, const JobRecord& record) {
  write_config(record_file(out, id), {{"state", word_of(record.state)},
                                      {"step", record.step},
                                      {"key", record.key},
                                      {"content", record.content},
                                      {"command", record.command},
                                      {"started", record.started},
                                      {"finished", record.finished},
                                      {"seconds", record.seconds},
                                      {"expected_seconds", record.expected_seconds},
                                      {"peak_bytes", record.peak_bytes},
                                      {"disk_bytes", record.disk_bytes},
                                      {"attempts", record.attempts},
                                      {"status", record.status}});
}

bool is_done(const fs::path& out, const Job& job) {
  std::error_code error;
  if (!fs::is_directory(job.folder, error)) return false;
  const std::optional<JobRecord> record = read_record(out, job.id);
  return record && record->state == JobRecord::State::kDone;
}

void accept_other_code(const fs::path& out, Plan& plan) {
  std::multimap<std::string, std::string> by_content;  // of what is done
  for (const std::string& id : recorded_jobs(out)) {
    const std::optional<JobRecord> record = read_record(out, id);
    if (record && record->state == JobRecord::State::kDone) by_content.emplace(record->content, id);
  }
  std::vector<std::pair<std::string, std::string>> renamed;
  const auto rename_in = [&](Job& job, const std::string& before, const std::string& after) {
    for (std::string& word : job.command) replace_all(word, before, after);
    std::string folder = job.folder.string();
    replace_all(folder, before, after);
    job.folder = folder;
  };
  for (Job& job : plan.jobs) {
    for (const auto& [before, after] : renamed) rename_in(job, before, after);
    if (is_done(out, job)) continue;
    const auto [first, last] = by_content.equal_range(job.content);
    for (auto candidate = first; candidate != last; ++candidate) {
      Job other = job;
      other.id = candidate->second;
      rename_in(other, job.id, other.id);
      // The same command but for the place of the program: what it read was made by the jobs accepted before it.
      if (!is_done(out, other) ||
          arguments_of(read_record(out, other.id)->command) != arguments_of(shell_line(other.command)))
        continue;
      renamed.emplace_back(job.id, other.id);
      job = std::move(other);
      break;
    }
  }
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  char stamp[32];
  std::strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  return stamp;
}

}  // namespace anigen::experiment
