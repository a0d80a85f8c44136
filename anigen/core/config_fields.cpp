#include "anigen/core/config_fields.h"

namespace anigen {

namespace {

template <typename T>
Json number_schema(const char* type, const FieldRange<T>& range) {
  Json schema{{"type", type}};
  if (range.lowest > std::numeric_limits<T>::lowest()) schema["minimum"] = range.lowest;
  if (range.highest < std::numeric_limits<T>::max()) schema["maximum"] = range.highest;
  return schema;
}

Json list_schema(const char* type) { return {{"type", "array"}, {"items", {{"type", type}}}}; }

}  // namespace

template <typename T, typename Read>
void ConfigFields::visit(const std::string& name, T& value, Need need, Json schema, Read read) {
  if (pass_ == Pass::kRead) {
    if (need == Need::kRequired) reader_->require(name);
    value = read();
  } else if (pass_ == Pass::kWrite) {
    (*json_)[name] = value;
  } else {
    if (need == Need::kOptional) schema["default"] = value;
    describe(name, std::move(schema), need);
  }
}

void ConfigFields::operator()(const std::string& name, std::int64_t& value, FieldRange<std::int64_t> range, Need need) {
  visit(name, value, need, number_schema("integer", range),
        [&] { return reader_->integer(name, value, range.lowest, range.highest); });
}

void ConfigFields::operator()(const std::string& name, double& value, FieldRange<double> range, Need need) {
  visit(name, value, need, number_schema("number", range),
        [&] { return reader_->number(name, value, range.lowest, range.highest); });
}

void ConfigFields::operator()(const std::string& name, bool& value, Need need) {
  visit(name, value, need, {{"type", "boolean"}}, [&] { return reader_->boolean(name, value); });
}

void ConfigFields::operator()(const std::string& name, std::string& value, Need need) {
  visit(name, value, need, {{"type", "string"}}, [&] { return reader_->text(name, value); });
}

void ConfigFields::operator()(const std::string& name, std::string& value, const std::vector<std::string>& words,
                              Need need) {
  visit(name, value, need, {{"enum", words}}, [&] { return reader_->choice(name, value, words); });
}

void ConfigFields::operator()(const std::string& name, std::filesystem::path& value, Need need) {
  std::string text = value.string();
  (*this)(name, text, need);
  value = text;
}

void ConfigFields::operator()(const std::string& name, std::vector<std::int64_t>& value, Need need) {
  visit(name, value, need, list_schema("integer"), [&] { return reader_->integers(name, value); });
}

void ConfigFields::operator()(const std::string& name, std::vector<double>& value, Need need) {
  visit(name, value, need, list_schema("number"), [&] { return reader_->numbers(name, value); });
}

void ConfigFields::operator()(const std::string& name, std::vector<std::string>& value, Need need) {
  visit(name, value, need, list_schema("string"), [&] { return reader_->texts(name, value); });
}

void ConfigFields::or_null(const std::string& name, std::int64_t& value, FieldRange<std::int64_t> range) {
  if (null(name, value != 0)) {
    if (!reads() || reader_->has(name)) value = 0;
    return;
  }
  (*this)(name, value, range);
  if (pass_ == Pass::kDescribe) allow_null(name, value == 0);
}

void ConfigFields::custom(const std::string& name, const Json& schema, const std::function<void(const Json&)>& read,
                          const std::function<Json()>& write) {
  if (pass_ == Pass::kRead) {
    if (const Json* value = reader_->raw(name)) read(*value);
  } else if (pass_ == Pass::kWrite) {
    if (write) (*json_)[name] = write();
  } else {
    describe(name, schema, Need::kOptional);
  }
}

void ConfigFields::ignored(const std::string& name) {
  if (reads()) reader_->ignore(name);
  if (pass_ == Pass::kDescribe) describe(name, {{"deprecated", true}}, Need::kOptional);
}

void ConfigFields::unused(const std::string& name) {
  if (reads()) reader_->raw(name);
  if (pass_ == Pass::kDescribe) describe(name, {{"deprecated", true}}, Need::kOptional);
}

InputError ConfigFields::error(const std::string& name, const std::string& problem) const {
  return reads() ? reader_->error(name, problem) : InputError("", "/" + name, problem);
}

NotSupportedError ConfigFields::not_supported(const std::string& name, const std::string& feature) const {
  return reads() ? NotSupportedError(reader_->file(), reader_->pointer_to(name), feature)
                 : NotSupportedError("", "/" + name, feature);
}

void ConfigFields::nested(const std::string& name, const std::function<void(ConfigFields&)>& fields) {
  if (pass_ == Pass::kRead) {
    ConfigReader below = reader_->object(name);
    ConfigFields inner(below);
    fields(inner);
    below.finish();
  } else if (pass_ == Pass::kWrite) {
    Json& below = (*json_)[name] = Json::object();
    ConfigFields inner(Pass::kWrite, below);
    fields(inner);
  } else {
    describe(name, object_schema(fields), Need::kOptional);
  }
}

bool ConfigFields::null(const std::string& name, bool set) {
  if (pass_ == Pass::kRead) {
    const Json* value = reader_->raw(name);
    return value == nullptr || value->is_null();
  }
  if (pass_ == Pass::kWrite && !set) (*json_)[name] = nullptr;
  return pass_ == Pass::kWrite && !set;
}

void ConfigFields::describe(const std::string& name, Json schema, Need need) {
  (*json_)["properties"][name] = std::move(schema);
  if (need == Need::kRequired) (*json_)["required"].push_back(name);
}

void ConfigFields::allow_null(const std::string& name, bool by_default) {
  Json& schema = (*json_)["properties"][name];
  if (schema.contains("type")) schema["type"] = {schema["type"], "null"};
  if (schema.contains("enum")) schema["enum"].push_back(nullptr);
  if (by_default) schema["default"] = nullptr;
}

void OptionCheck::operator()(bool valid, const std::string& key, const std::string& problem) const {
  if (!valid) throw InputError(file, key.empty() ? pointer : pointer + "/" + key, problem);
}

void OptionCheck::heads(const std::string& key, std::int64_t heads, std::int64_t channels) const {
  (*this)(heads > 0 && channels % heads == 0, key,
          std::to_string(heads) + " heads do not divide " + std::to_string(channels) + " channels");
}

Json object_schema(const std::function<void(ConfigFields&)>& fields) {
  Json schema{{"type", "object"}, {"properties", Json::object()}, {"additionalProperties", false}};
  ConfigFields describe(ConfigFields::Pass::kDescribe, schema);
  fields(describe);
  return schema;
}

}  // namespace anigen
