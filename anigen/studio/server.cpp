#include "anigen/studio/server.h"

#include <httplib.h>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <memory>
#include <new>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/engine/animate.h"
#include "anigen/engine/rig.h"
#include "anigen/studio/access.h"
#include "anigen/studio/bounded_server.h"
#include "anigen/studio/job_options.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kConnections = 32;
constexpr int kStreams = 16;  // of those, the ones that may watch jobs
constexpr int kSeconds = 10;  // without a byte, after which a connection is closed
constexpr std::chrono::milliseconds kLook{100};
constexpr std::chrono::seconds kHeartbeat{15};

using Respond = std::function<Reply(const httplib::Request&)>;

void set_error(httplib::Response& response, int status, const std::string& problem) {
  response.status = status;
  response.set_content(Json{{"error", problem}}.dump(-1, ' ', false, Json::error_handler_t::replace),
                       "application/json");
}

/// The status and sentence of the exception being handled.
void set_failure(httplib::Response& response) {
  try {
    throw;
  } catch (const RequestError& error) {
    set_error(response, error.status(), error.what());
  } catch (const InputError& error) {
    set_error(response, 400, error.what());
  } catch (const Interrupted&) {
    set_error(response, 503, "the studio is stopping");
  } catch (const WriteError& error) {
    set_error(response, 507, error.what());
  } catch (const std::bad_alloc&) {
    set_error(response, 507, "out of memory");
  } catch (const std::exception& error) {
    log::warn("{}", error.what());
    set_error(response, 500, error.what());
  }
}

httplib::Server::Handler handler(Respond respond) {
  return [respond = std::move(respond)](const httplib::Request& request, httplib::Response& response) {
    try {
      Reply reply = respond(request);
      response.status = reply.status;
      for (const auto& [name, value] : reply.headers) response.set_header(name, value);
      response.set_content(reply.body, reply.type);
    } catch (...) {
      set_failure(response);
    }
  };
}

std::string id_of(const httplib::Request& request) { return request.matches[1]; }

Form form_of(const httplib::Request& request) {
  if (!request.is_multipart_form_data()) throw RequestError(415, "send multipart/form-data");
  Form form;
  for (const auto& [part, file] : request.files) form.try_emplace(part, Upload{file.filename, file.content});
  return form;
}

/// Server-sent events of a job, for one client.
class EventStream {
 public:
  EventStream(const Api& api, std::string id) : api_(api), id_(std::move(id)) {}

  /// Sends what has changed, else waits a little. @return false when the client is gone
  bool go_on(httplib::DataSink& sink) {
    if (ended_) {
      sink.done();
      return true;
    }
    Api::Event event;
    try {
      event = api_.event(id_);
    } catch (const RequestError&) {  // it was removed
      ended_ = true;
      return true;
    }
    ended_ = event.ended;
    if (event.data != last_) return send(sink, "event: job\ndata: " + (last_ = std::move(event.data)) + "\n\n");
    if (std::chrono::steady_clock::now() - sent_ > kHeartbeat) return send(sink, ": \n\n");
    if (!ended_) std::this_thread::sleep_for(kLook);
    return true;
  }

 private:
  bool send(httplib::DataSink& sink, const std::string& text) {
    sent_ = std::chrono::steady_clock::now();
    return sink.write(text.data(), text.size());
  }

  const Api& api_;
  std::string id_, last_;
  std::chrono::steady_clock::time_point sent_ = std::chrono::steady_clock::now();
  bool ended_ = false;
};

httplib::ContentProviderWithoutLength events_of(const Api& api, const std::string& id) {
  return [stream = std::make_shared<EventStream>(api, id)](std::size_t, httplib::DataSink& sink) {
    return stream->go_on(sink);
  };
}

/// The part of a file that its request asks for (RFC 9110), or all of it.
Reply part_of(Reply file, const httplib::Request& request) {
  httplib::Ranges ranges;
  // No answer names its version, so a condition on one (If-Range) cannot hold.
  if (request.method != "GET" || request.has_header("If-Range") ||
      !httplib::detail::parse_range_header(request.get_header_value("Range"), ranges) || ranges.size() != 1)
    return file;
  const auto size = static_cast<ssize_t>(file.body.size());
  ssize_t first = ranges.front().first, last = ranges.front().second;
  if (first < 0) {  // so many bytes at the end
    first = last < 0 ? 0 : std::max<ssize_t>(0, size - last);
    last = size - 1;
  }
  if (last < 0 || last >= size) last = size - 1;
  if (first > last) {
    Reply refused;
    refused.status = 416;
    refused.body = Json{{"error", "the file has " + std::to_string(size) + " bytes"}}.dump();
    refused.headers["Content-Range"] = "bytes */" + std::to_string(size);
    return refused;
  }
  file.status = 206;
  file.headers["Content-Range"] =
      "bytes " + std::to_string(first) + "-" + std::to_string(last) + "/" + std::to_string(size);
  file.body = file.body.substr(static_cast<std::size_t>(first), static_cast<std::size_t>(last - first + 1));
  return file;
}

/// "/v1/jobs/{id}/files/{name}" as a regular expression.
std::string pattern_of(const std::string& path) {
  std::string pattern = path;
  replace_all(pattern, "{id}", "([a-z0-9]+)");
  replace_all(pattern, "{name}", "([a-z.]+)");
  return pattern;
}

Reply file_reply(const fs::path& file, const std::string& type) {
  std::error_code ignored;
  if (!fs::is_regular_file(file, ignored)) throw RequestError(404, "there is no such page");
  Reply reply;
  reply.type = type;
  reply.body = read_file(file);
  return reply;
}

std::string type_of(const fs::path& file) {
  const std::string extension = file.extension();
  if (extension == ".html") return "text/html; charset=utf-8";
  if (extension == ".css") return "text/css; charset=utf-8";
  if (extension == ".png") return "image/png";
  return extension == ".js" ? "text/javascript; charset=utf-8" : "application/octet-stream";
}

Json gallery_names(const fs::path& gallery) {
  std::vector<std::string> names;
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(gallery, ignored))
    if (entry.path().extension() == ".png") names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace

class Server::Work {
 public:
  Work(Api& api, const ServerOptions& options)
      : options_(options),
        access_{is_loopback(options.host), options.token},
        server_(std::chrono::duration<double>(options.head_seconds)) {
    set_limits();
    add_guards();
    add_job_routes(api);
    add_pages();
    port_ = options.port == 0 ? server_.bind_to_any_port(options.host) : options.port;
    if (port_ <= 0 || (options.port != 0 && !server_.bind_to_port(options.host, options.port)))
      throw InputError("", options.host + ":" + std::to_string(options.port),
                       "cannot be listened to; choose another --port or --host");
    thread_ = std::thread([this] { server_.listen_after_bind(); });
    while (!server_.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  ~Work() { stop(); }

  void stop() {
    if (!thread_.joinable()) return;
    server_.stop();
    thread_.join();
  }

  int port() const { return port_; }
  const ServerOptions& options() const { return options_; }
  const std::vector<std::pair<std::string, std::string>>& routes() const { return routes_; }

 private:
  void set_limits() {
    server_.new_task_queue = [] { return new httplib::ThreadPool(kConnections); };
    server_.set_read_timeout(kSeconds);
    server_.set_write_timeout(kSeconds);
    server_.set_payload_max_length(options_.most_bytes);
    // httplib's own also sets SO_REUSEPORT, with which two studios share a port.
    server_.set_socket_options([](socket_t socket) {
      const int yes = 1;
      ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    server_.set_default_headers({{"X-Content-Type-Options", "nosniff"},
                                 {"X-Frame-Options", "DENY"},
                                 {"Referrer-Policy", "no-referrer"},
                                 {"Cache-Control", "no-store"},
                                 {"Content-Security-Policy", "default-src 'self' 'unsafe-inline' blob: data:"}});
  }

  /// Refusals by headers alone. @return status; 0: the request may come in
  int refuse(const httplib::Request& request, httplib::Response& response) const {
    Refusal refusal{403, access_.refusal(request.get_header_value("Host"), request.get_header_value("Origin"))};
    if (refusal.problem.empty()) {
      refusal = refusal_of({request.get_header_value("Content-Length"), request.get_header_value("Transfer-Encoding"),
                            request.get_header_value("Content-Encoding")},
                           options_.most_bytes);
    }
    if (refusal.problem.empty() &&
        !access_.admits(request.get_header_value("Authorization"), request.get_header_value("Cookie")))
      refusal = {401, "open the address that the studio printed, or send its token as Authorization: Bearer"};
    if (refusal.problem.empty()) return 0;
    set_error(response, refusal.status, refusal.problem);
    return refusal.status;
  }

  /// The address that was printed: the browser keeps its token as a cookie.
  bool enters(const httplib::Request& request, httplib::Response& response) const {
    if (access_.token.empty() || request.path != "/" || request.get_param_value("token") != access_.token) return false;
    if (!access_.refusal(request.get_header_value("Host"), request.get_header_value("Origin")).empty()) return false;
    response.set_header("Set-Cookie", std::string(kTokenCookie) + "=" + access_.token + "; HttpOnly; SameSite=Strict");
    response.set_redirect("/", 303);
    return true;
  }

  void add_guards() {
    using Response = httplib::Server::HandlerResponse;
    server_.set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
      if (enters(request, response)) return Response::Handled;
      return refuse(request, response) == 0 ? Response::Unhandled : Response::Handled;
    });
    server_.set_expect_100_continue_handler([this](const httplib::Request& request, httplib::Response& response) {
      const int status = refuse(request, response);
      return status == 0 ? 100 : status;
    });
    server_.set_error_handler([](const httplib::Request&, httplib::Response& response) {
      if (!response.body.empty()) return;
      const int status = response.status;
      set_error(response, status,
                status == 404   ? "there is no such page"
                : status == 413 ? "the request is too large"
                : status == 416 ? "the range is malformed"
                                : "the request is malformed, or was cut off");
    });
    server_.set_exception_handler([](const httplib::Request&, httplib::Response& response, std::exception_ptr problem) {
      try {
        std::rethrow_exception(std::move(problem));
      } catch (...) {
        set_failure(response);
      }
    });
  }

  void add(const std::string& method, const std::string& path, Respond respond) {
    const std::string pattern = pattern_of(path);
    routes_.emplace_back(method, path);
    const httplib::Server::Handler handle = handler(std::move(respond));
    if (method == "GET") server_.Get(pattern, handle);
    if (method == "POST") server_.Post(pattern, handle);
    if (method == "DELETE") server_.Delete(pattern, handle);
  }

  void add_job_routes(Api& api) {
    const std::string job = "/v1/jobs/{id}";
    for (const std::string& kind : job_kinds()) {
      add("POST", "/v1/3d/" + kind + "s",
          [&api, kind](const auto& request) { return api.submit(kind, form_of(request)); });
    }
    add("GET", "/v1/jobs", [&api](const auto&) { return api.list(); });
    add("GET", job, [&api](const auto& request) { return api.show(id_of(request)); });
    add("DELETE", job, [&api](const auto& request) { return api.end(id_of(request)); });
    add_events(api, job + "/events");
    add("GET", job + "/files/{name}",
        [&api](const auto& request) { return part_of(api.file(id_of(request), request.matches[2]), request); });
    add("POST", job + "/rebind", [&api](const auto& request) { return api.rebind(id_of(request), request.body); });
    add("POST", job + "/rename", [&api](const auto& request) { return api.rename(id_of(request), request.body); });
    add("POST", job + "/lint", [&api](const auto& request) { return api.lint(id_of(request)); });
    add("POST", job + "/compare", [&api](const auto& request) { return api.compare(id_of(request), request.body); });
    add("GET", "/health", [](const auto&) {
      Reply reply;
      reply.body = R"({"status": "ok"})";
      return reply;
    });
    add("GET", "/ready", [&api](const auto&) { return api.ready(); });
    add("GET", "/metrics", [&api](const auto&) { return api.metrics(); });
    add("GET", "/openapi.json", [this](const auto&) { return file_reply(options_.openapi, "application/json"); });
    add("GET", "/v1/studio", [this, &api](const auto&) {
      Reply reply;
      reply.body = Json{{"version", named_version()},
                        {"three", !options_.three.empty()},
                        {"validator", !options_.validator.empty()},
                        {"gallery", gallery_names(options_.gallery)},
                        {"methods", rig_methods()},
                        {"species", engine::template_words()},
                        {"motions", engine::motion_words()},
                        {"names", name_presets()},
                        {"limits",
                         {{"bytes", options_.most_bytes},
                          {"queued", api.most_queued()},
                          {"job_memory", options_.job_gigabytes},
                          {"job_minutes", options_.job_minutes}}}}
                       .dump();
      return reply;
    });
  }

  void add_events(const Api& api, const std::string& path) {
    routes_.emplace_back("GET", path);
    server_.Get(pattern_of(path), [this, &api](const httplib::Request& request, httplib::Response& response) {
      try {
        const std::string id = id_of(request);
        api.event(id);
        if (++streams_ > kStreams) {
          --streams_;
          throw RequestError(503, "too many clients watch jobs; ask for the job itself");
        }
        response.set_chunked_content_provider("text/event-stream", events_of(api, id), [this](bool) { --streams_; });
      } catch (...) {
        set_failure(response);
      }
    });
  }

  /// Files below `folder` of names that cannot leave it.
  void add_folder(const std::string& pattern, const fs::path& folder) {
    if (folder.empty()) return;
    server_.Get(pattern, handler([folder](const auto& request) {
                  const std::string name = request.matches[1];
                  if (name.find("..") != std::string::npos) throw RequestError(404, "there is no such page");
                  return file_reply(folder / name, type_of(name));
                }));
  }

  void add_pages() {
    if (options_.page.empty()) return;
    server_.Get(
        "/", handler([this](const auto&) { return file_reply(options_.page / "index.html", type_of("index.html")); }));
    add_folder("/([a-z_]+\\.(?:js|css))", options_.page);
    add_folder("/gallery/([A-Za-z0-9_-]+\\.png)", options_.gallery);
    add_folder("/three/((?:build|examples/jsm)/[A-Za-z0-9_./-]+\\.js)", options_.three);
    add_folder("/gltf-validator/(gltf_validator\\.dart\\.js)", options_.validator);
  }

  ServerOptions options_;
  Access access_;
  BoundedServer server_;
  std::vector<std::pair<std::string, std::string>> routes_;
  std::atomic<int> streams_{0};
  int port_ = 0;
  std::thread thread_;
};

Server::Server(Api& api, const ServerOptions& options) : work_(std::make_unique<Work>(api, options)) {}
Server::~Server() = default;

int Server::port() const { return work_->port(); }

std::vector<std::pair<std::string, std::string>> Server::routes() const { return work_->routes(); }

std::string Server::address() const {
  const std::string& host = work_->options().host;
  const std::string shown = host.find(':') != std::string::npos ? "[" + host + "]" : host;
  const std::string& token = work_->options().token;
  return "http://" + shown + ":" + std::to_string(port()) + "/" + (token.empty() ? "" : "?token=" + token);
}

void Server::stop() { work_->stop(); }

}  // namespace anigen::studio
