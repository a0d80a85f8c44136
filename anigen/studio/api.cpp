#include "anigen/studio/api.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <optional>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/text.h"
#include "anigen/engine/evaluate.h"
#include "anigen/engine/files.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/studio/job_options.h"
#include "anigen/studio/job_work.h"
#include "anigen/studio/rebind.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

constexpr JsonLimits kRequestLimits{16, 100'000};
constexpr std::size_t kMostMethods = 6;

struct FileType {
  const char* name;
  const char* type;
  const char* made_of;  ///< the file of the job that it is converted from; null: it is there or not
};

constexpr FileType kFiles[] = {
    {"rigged.glb", "model/gltf-binary", nullptr},
    {"rigged.fbx", "application/octet-stream", kRiggedFile},
    {"rigged.usdz", "model/vnd.usdz+zip", kRiggedFile},
    {"edited.glb", "model/gltf-binary", nullptr},
    {"edited.fbx", "application/octet-stream", kEditedFile},
    {"edited.usdz", "model/vnd.usdz+zip", kEditedFile},
    {"preview.png", "image/png", nullptr},
};

Reply reply_of(const Json& json, int status = 200) {
  Reply reply;
  reply.status = status;
  reply.body = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  return reply;
}

Json request_json(const std::string& body) {
  const Json json = parse_json(body.empty() ? "{}" : body, "request", kRequestLimits);
  if (!json.is_object()) throw InputError("request", "", "is no JSON object");
  return json;
}

/// Last part of a path that a client says, for people: without control characters, and short.
std::string shown_name(const std::string& name) {
  const std::size_t slash = name.find_last_of("/\\");
  std::string shown;
  for (const char c : slash == std::string::npos ? name : name.substr(slash + 1))
    shown += static_cast<unsigned char>(c) < 32 || c == 127 ? '_' : c;
  if (shown.size() > 120) shown = "upload" + io::lower_extension(shown);
  return as_utf8(shown);
}

/// Name of a download that a header can hold.
std::string header_name(const std::string& stem, const std::string& extension) {
  std::string name;
  for (const char c : stem)
    name += (std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '_') ? c : '_';
  return name.substr(0, 80) + extension;
}

std::string milliseconds_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

}  // namespace

JobRecord Api::known(const std::string& id) const {
  std::optional<JobRecord> record = store_.find(id);
  if (!record) throw RequestError(404, "there is no such job");
  return *std::move(record);
}

JobRecord Api::done(const std::string& id) const {
  JobRecord record = known(id);
  if (record.state != JobState::kDone)
    throw RequestError(409, std::string("the job is ") + word(record.state) + ", and has no rig");
  return record;
}

Json Api::described(const JobRecord& record) const {
  Json json = to_json(record);
  json.erase("input");
  const std::optional<JobRunner::Progress> progress = runner_.progress(record.id);
  json["stage"] = progress ? as_utf8(progress->stage) : "";
  json["fraction"] = record.state == JobState::kDone ? 1.0 : progress ? progress->fraction : 0.0;
  std::error_code ignored;
  json["edited"] = fs::exists(store_.folder(record.id) / kEditedFile, ignored);
  return json;
}

Reply Api::submit(const Upload& file, const std::string& options) {
  if (file.name.empty()) throw InputError("", "file", "has no name; send it as a file with its extension");
  if (file.bytes.empty()) throw InputError(shown_name(file.name), "", "is empty");
  JobRecord record;
  record.kind = kind_of_upload(file.name);
  record.name = shown_name(file.name);
  record.options = request_json(options);
  parse_job_options(record.options, record.kind);
  const std::optional<JobRecord> accepted = runner_.submit(record, io::lower_extension(file.name), file.bytes);
  if (!accepted) throw RequestError(429, "too many jobs wait; try again when one has ended");
  return reply_of(described(*accepted), 201);
}

Reply Api::list() const {
  Json jobs = Json::array();
  for (const JobRecord& record : store_.list()) jobs.push_back(described(record));
  return reply_of({{"jobs", jobs}});
}

Reply Api::metrics() const {
  std::map<std::string, std::size_t> counts;
  for (const JobState state :
       {JobState::kQueued, JobState::kRunning, JobState::kDone, JobState::kFailed, JobState::kCancelled})
    counts[word(state)] = 0;
  for (const JobRecord& record : store_.list()) ++counts[word(record.state)];
  Reply reply;
  reply.type = "text/plain; version=0.0.4";
  reply.body = "# TYPE anigen_jobs gauge\n";
  for (const auto& [state, count] : counts)
    reply.body += "anigen_jobs{state=\"" + state + "\"} " + std::to_string(count) + "\n";
  return reply;
}

Reply Api::show(const std::string& id) const { return reply_of(described(known(id))); }

Reply Api::cancel(const std::string& id) {
  const JobRecord record = known(id);
  if (!runner_.cancel(id) && !has_ended(known(id).state))
    throw RequestError(409, "the job is just changing; try again");
  return show(id);
}

Reply Api::remove(const std::string& id) {
  known(id);
  if (!store_.remove(id)) throw RequestError(409, "the job has not ended; cancel it first");
  return reply_of({{"removed", id}});
}

Reply Api::file(const std::string& id, const std::string& name) {
  const JobRecord record = known(id);
  const fs::path folder = store_.folder(id);
  Reply reply;
  if (name == "input") {
    reply.type = "application/octet-stream";
    reply.body = read_file(folder / record.input);
    reply.headers["Content-Disposition"] = "attachment";
    return reply;
  }
  const auto* type =
      std::find_if(std::begin(kFiles), std::end(kFiles), [&](const FileType& f) { return name == f.name; });
  if (type == std::end(kFiles)) throw RequestError(404, "a job has no such file");
  const fs::path path = folder / name;
  if (type->made_of != nullptr && fs::exists(folder / type->made_of)) {
    const std::lock_guard<std::mutex> turn(computing_);
    if (!fs::exists(path)) engine::save(*asset_of(id, type->made_of), path);
  }
  if (!fs::exists(path)) throw RequestError(404, "the job has no " + name);
  reply.type = type->type;
  reply.body = read_file(path);
  const std::string stem = fs::path(record.name).stem().string() + (name.rfind("edited", 0) == 0 ? "_edited" : "");
  if (path.extension() != ".png")
    reply.headers["Content-Disposition"] = "attachment; filename=\"" + header_name(stem, path.extension()) + "\"";
  return reply;
}

/// @pre computing_ is held
std::shared_ptr<const Asset> Api::asset_of(const std::string& id, const std::string& file) {
  const fs::path path = store_.folder(id) / file;
  const fs::file_time_type time = fs::last_write_time(path);
  if (loaded_ != path || time != loaded_time_ || !asset_) {
    asset_ = std::make_shared<const Asset>(engine::load(path));
    loaded_ = path;
    loaded_time_ = time;
  }
  return asset_;
}

fs::path Api::latest(const std::string& id) const {
  return fs::exists(store_.folder(id) / kEditedFile) ? kEditedFile : kRiggedFile;
}

void Api::keep_edit(const std::string& id, const std::string& glb) const {
  const fs::path folder = store_.folder(id);
  for (const FileType& type : kFiles) {
    std::error_code ignored;
    if (type.made_of != nullptr && std::string(type.made_of) == kEditedFile) fs::remove(folder / type.name, ignored);
  }
  write_file_atomically(folder / kEditedFile, glb);
}

Reply Api::rebind(const std::string& id, const std::string& body) {
  const JobRecord record = done(id);
  const Json request = request_json(body);
  ConfigReader reader(request, "request");
  reader.require("joints");
  const Skeleton skeleton = skeleton_of_joints(*reader.raw("joints"));
  const std::string method = reader.choice("method", "heat", {"heat", "geovoxel", "nearest"});
  const bool draft = reader.boolean("draft", false);
  reader.finish();
  const std::lock_guard<std::mutex> turn(computing_);
  const auto started = std::chrono::steady_clock::now();
  Rebound bound = rebound(*asset_of(id, kRiggedFile), skeleton, method);
  if (!draft) bound.asset.animations = clips_of(bound.asset, parse_job_options(record.options, record.kind), nullptr);
  Reply reply;
  reply.type = "model/gltf-binary";
  reply.body = engine::save_bytes(bound.asset, "glb");
  if (!draft) keep_edit(id, reply.body);
  const double total = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started).count();
  reply.headers = {{"X-Bind-Milliseconds", milliseconds_text(bound.milliseconds)},
                   {"X-Total-Milliseconds", milliseconds_text(total)}};
  return reply;
}

Reply Api::lint(const std::string& id) {
  done(id);
  const std::lock_guard<std::mutex> turn(computing_);
  Json findings = Json::array();
  const std::string file = latest(id);
  for (const engine::Finding& finding : engine::lint(*asset_of(id, file))) {
    findings.push_back({{"code", finding.code},
                        {"severity", finding.severity},
                        {"sentence", finding.sentence},
                        {"count", finding.count},
                        {"share", finding.share},
                        {"place_kind", finding.place_kind},
                        {"place", finding.place}});
  }
  return reply_of({{"file", file}, {"findings", findings}});
}

Reply Api::compare(const std::string& id, const std::string& body) {
  const JobRecord record = done(id);
  const Json request = request_json(body);
  ConfigReader reader(request, "request");
  const std::vector<std::string> methods = reader.texts("methods", {"curve", "pinocchio", "heat"});
  reader.finish();
  if (methods.empty() || methods.size() > kMostMethods)
    throw reader.error("methods", "names none or more than " + std::to_string(kMostMethods));
  std::vector<JobRecord> wanted;
  for (const std::string& method : methods) {
    JobRecord other;
    other.kind = "mesh";
    other.name = fs::path(record.name).stem().string() + "." + method + ".glb";
    other.group = record.group.empty() ? record.id : record.group;
    other.options = {{"method", method}, {"keep_skeleton", false}};
    parse_job_options(other.options, "mesh");
    wanted.push_back(std::move(other));
  }
  const std::string mesh = read_file(store_.folder(id) / latest(id));
  Json jobs = Json::array();
  for (const JobRecord& other : wanted) {
    const std::optional<JobRecord> accepted = runner_.submit(other, ".glb", mesh);
    if (accepted) jobs.push_back(described(*accepted));
  }
  if (jobs.empty()) throw RequestError(429, "too many jobs wait; try again when one has ended");
  return reply_of({{"jobs", jobs}}, 201);
}

Reply Api::evaluate(const std::string& id, const Upload& truth) {
  done(id);
  if (truth.bytes.empty()) throw InputError("", "truth", "is missing or empty; send it as a file");
  if (kind_of_upload(truth.name) != "mesh") throw InputError(shown_name(truth.name), "", "is no rig to compare with");
  const std::lock_guard<std::mutex> turn(computing_);
  const Asset expected = engine::load_bytes(truth.bytes, "truth" + io::lower_extension(truth.name));
  engine::EvaluateOptions options;
  options.groups = {"skeleton", "transport", "skin", "surface"};
  options.surface_samples = 20'000;
  const std::string file = latest(id);
  const engine::Scores scores = engine::evaluate(*asset_of(id, file), expected, options);
  return reply_of(
      {{"file", file}, {"values", scores.values}, {"not_computed", scores.not_computed}, {"notes", scores.notes}});
}

}  // namespace anigen::studio
