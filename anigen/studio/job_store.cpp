#include "anigen/studio/job_store.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

constexpr const char* kRecordFile = "job.json";
constexpr std::uintmax_t kLargestRecord = 4 << 20;

JobState parse_state(const std::string& text, const std::string& file) {
  for (const JobState state :
       {JobState::kQueued, JobState::kRunning, JobState::kDone, JobState::kFailed, JobState::kCancelled}) {
    if (text == word(state)) return state;
  }
  throw InputError(file, "/state", "\"" + text + "\" is no state of a job");
}

std::string id_of(std::size_t number) {
  char text[32];
  std::snprintf(text, sizeof text, "j%06zu", number);
  return text;
}

/// Number of an id; 0: it is none.
std::size_t number_of(const std::string& id) {
  if (id.size() < 7 || id.size() > 16 || id[0] != 'j') return 0;
  if (id.find_first_not_of("0123456789", 1) != std::string::npos) return 0;
  return std::stoull(id.substr(1));
}

/// A job whose record cannot be read, as one that failed.
JobRecord damaged(const std::string& id, const std::string& problem) {
  JobRecord record;
  record.id = record.name = id;
  record.kind = "rig";
  record.state = JobState::kFailed;
  record.error = problem;
  return record;
}

std::map<std::string, std::string> parse_texts(ConfigReader& reader, const std::string& key) {
  try {
    const Json* json = reader.raw(key);
    return json == nullptr ? std::map<std::string, std::string>() : json->get<std::map<std::string, std::string>>();
  } catch (const Json::exception&) {
    throw reader.error(key, "is no object of texts");
  }
}

std::map<std::string, std::string> parse_inputs(ConfigReader& reader) {
  std::map<std::string, std::string> inputs = parse_texts(reader, "inputs");
  for (const auto& [part, name] : inputs) {
    if (name.empty() || name != fs::path(name).filename())
      throw reader.error("inputs", "\"" + name + "\" is no file of the job's folder");
  }
  if (inputs.count("file") == 0) throw reader.error("inputs", "has no \"file\"");
  return inputs;
}

std::vector<std::pair<std::string, double>> parse_stages(const Json& json, const std::string& file) {
  try {
    return json.get<std::vector<std::pair<std::string, double>>>();
  } catch (const Json::exception&) {
    throw InputError(file, "/stages", "is no list of names and seconds");
  }
}

/// Settles the state of a job that a studio left.
void settle(JobRecord& record) {
  if (record.state != JobState::kRunning) return;
  record.state = record.cancelling ? JobState::kCancelled : JobState::kQueued;
  if (record.cancelling) record.ended = seconds_now();
  if (record.cancelling || record.starts < JobStore::kMostStarts) return;
  record.state = JobState::kFailed;
  record.ended = seconds_now();
  record.error = "the studio ended " + std::to_string(record.starts) + " times while it worked on this; send it again";
}

}  // namespace

const std::vector<std::string>& job_kinds() {
  static const std::vector<std::string> kinds{"generation", "rig", "animation", "evaluation"};
  return kinds;
}

const char* word(JobState state) {
  switch (state) {
    case JobState::kQueued:
      return "queued";
    case JobState::kRunning:
      return "running";
    case JobState::kDone:
      return "done";
    case JobState::kFailed:
      return "failed";
    case JobState::kCancelled:
      return "cancelled";
  }
  return "failed";
}

bool has_ended(JobState state) { return state != JobState::kQueued && state != JobState::kRunning; }

void remove_leftovers(const fs::path& folder) {
  std::error_code ignored;
  fs::remove_all(folder / kScratchFolder, ignored);
  std::vector<fs::path> unfinished;
  const std::string mark = ".tmp-", own = mark + process_number();  // such as the record of a job that is cancelled now
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.find(mark) != std::string::npos && name.find(own) == std::string::npos) unfinished.push_back(entry.path());
  }
  for (const fs::path& file : unfinished) fs::remove_all(file, ignored);
}

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

Json to_json(const JobRecord& record) {
  return {{"id", record.id},
          {"kind", record.kind},
          {"name", record.name},
          {"inputs", record.inputs},
          {"names", record.names},
          {"options", record.options},
          {"group", record.group},
          {"source", record.source},
          {"state", word(record.state)},
          {"note", record.note},
          {"error", record.error},
          {"starts", record.starts},
          {"cancelling", record.cancelling},
          {"created", record.created},
          {"started", record.started},
          {"ended", record.ended},
          {"result", record.result},
          {"scores", record.scores},
          {"stages", record.stages}};
}

JobRecord job_record_from_json(const Json& json, const std::string& file) {
  ConfigReader reader(json, file);
  for (const char* key : {"id", "kind", "inputs", "state"}) reader.require(key);
  JobRecord record;
  record.id = reader.text("id", "");
  record.kind = reader.choice("kind", "rig", job_kinds());
  record.name = reader.text("name", "");
  record.inputs = parse_inputs(reader);
  record.names = parse_texts(reader, "names");
  record.names.emplace("file", record.name);
  for (const auto& [part, input] : record.inputs) record.names.emplace(part, input);
  if (const Json* options = reader.raw("options")) record.options = *options;
  record.group = reader.text("group", "");
  record.source = reader.text("source", "");
  record.state = parse_state(reader.text("state", ""), file);
  record.note = reader.text("note", "");
  record.error = reader.text("error", "");
  record.starts = static_cast<int>(reader.integer("starts", 0, 0, 1'000'000));
  record.cancelling = reader.boolean("cancelling", false);
  record.created = reader.number("created", 0.0);
  record.started = reader.number("started", 0.0);
  record.ended = reader.number("ended", 0.0);
  if (const Json* result = reader.raw("result")) record.result = *result;
  if (const Json* scores = reader.raw("scores")) record.scores = *scores;
  if (const Json* stages = reader.raw("stages")) record.stages = parse_stages(*stages, file);
  return record;
}

JobStore::JobStore(const fs::path& folder) : jobs_(folder / "jobs") {
  lock_ = FileLock::try_lock(folder / "lock", FileLock::Kind::kExclusive);
  if (!lock_) throw InputError(folder.string(), "", "another studio works in this folder; choose another --output");
  make_folders(jobs_);
  read_all();
}

void JobStore::read_all() {
  for (const fs::directory_entry& entry : fs::directory_iterator(jobs_)) {
    const std::string id = entry.path().filename().string();
    const std::size_t number = number_of(id);
    if (number == 0 || !entry.is_directory()) continue;
    next_ = std::max(next_, number + 1);
    const fs::path file = entry.path() / kRecordFile;
    if (!fs::exists(file)) {
      std::error_code ignored;
      fs::remove_all(entry.path(), ignored);
      continue;
    }
    JobRecord record;
    try {
      record = job_record_from_json(parse_json(read_file(file, kLargestRecord), file.string()), file.string());
      if (record.id != id) throw InputError(file.string(), "/id", "\"" + record.id + "\" is not of this folder");
    } catch (const InputError& problem) {
      log::warn("{}", problem.what());
      records_[id] = damaged(id, problem.what());
      continue;
    }
    const JobState before = record.state;
    settle(record);
    if (before == JobState::kRunning) remove_leftovers(entry.path());
    if (record.state != before) write(record);
    records_[id] = std::move(record);
  }
}

void JobStore::write(const JobRecord& record) const { write_config(folder(record.id) / kRecordFile, to_json(record)); }

JobRecord JobStore::create(JobRecord record, const std::vector<InputFile>& files) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    record.id = id_of(next_++);
  }
  for (const InputFile& file : files)
    record.inputs[file.part] = "input" + (file.part == "file" ? "" : "_" + file.part) + file.extension;
  record.state = JobState::kQueued;
  record.created = seconds_now();
  const fs::path place = folder(record.id);
  try {
    for (const InputFile& file : files) write_file_atomically(place / record.inputs.at(file.part), file.bytes);
    write(record);  // from here on the job is accepted
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(place, ignored);
    throw;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  records_[record.id] = record;
  return record;
}

JobRecord JobStore::adopt(const fs::path& from) {
  const fs::path file = from / kRecordFile;
  JobRecord record = job_record_from_json(parse_json(read_file(file, kLargestRecord), file.string()), file.string());
  if (!has_ended(record.state)) throw InputError(file.string(), "/state", "the job has not ended");
  const double later = seconds_now() - record.ended;
  for (double* time : {&record.created, &record.started, &record.ended}) *time += later;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    record.id = id_of(next_++);
  }
  const fs::path place = folder(record.id);
  try {
    for (const fs::directory_entry& entry : fs::directory_iterator(from))
      if (entry.is_regular_file() && entry.path().filename() != kRecordFile)
        write_file_atomically(place / entry.path().filename(), read_file(entry.path()));
    write(record);
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(place, ignored);
    throw;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  records_[record.id] = record;
  return record;
}

std::optional<JobRecord> JobStore::find(const std::string& id) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = records_.find(id);
  if (found == records_.end()) return std::nullopt;
  return found->second;
}

std::vector<JobRecord> JobStore::list() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<JobRecord> jobs;
  for (const auto& [id, record] : records_) jobs.push_back(record);
  std::stable_sort(jobs.begin(), jobs.end(),
                   [](const JobRecord& a, const JobRecord& b) { return number_of(a.id) < number_of(b.id); });
  return jobs;
}

std::optional<JobRecord> JobStore::update(const std::string& id, const std::function<void(JobRecord&)>& change) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = records_.find(id);
  if (found == records_.end()) return std::nullopt;
  JobRecord changed = found->second;
  change(changed);
  write(changed);
  return found->second = std::move(changed);
}

void JobStore::update_anyway(const std::string& id, const std::function<void(JobRecord&)>& change) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = records_.find(id);
  if (found == records_.end()) return;
  change(found->second);
  try {
    write(found->second);
  } catch (const std::exception& error) {
    log::warn("job {}: {}", id, error.what());
  }
}

bool JobStore::remove(const std::string& id) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = records_.find(id);
  if (found == records_.end() || !has_ended(found->second.state)) return false;
  // Without its record a folder counts as never accepted, should the rest stay.
  remove_lastingly(folder(id) / kRecordFile);
  records_.erase(found);
  std::error_code ignored;
  fs::remove_all(folder(id), ignored);
  return true;
}

}  // namespace anigen::studio
