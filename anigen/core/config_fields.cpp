#include "anigen/core/config_fields.h"

namespace anigen {

template <typename T, typename Read>
void ConfigFields::visit(const std::string& name, T& value, Need need, Read read) {
  if (reads()) {
    if (need == Need::kRequired) reader_->require(name);
    value = read();
  } else {
    (*json_)[name] = value;
  }
}

void ConfigFields::operator()(const std::string& name, std::int64_t& value, FieldRange<std::int64_t> range, Need need) {
  visit(name, value, need, [&] { return reader_->integer(name, value, range.lowest, range.highest); });
}

void ConfigFields::operator()(const std::string& name, double& value, FieldRange<double> range, Need need) {
  visit(name, value, need, [&] { return reader_->number(name, value, range.lowest, range.highest); });
}

void ConfigFields::operator()(const std::string& name, bool& value, Need need) {
  visit(name, value, need, [&] { return reader_->boolean(name, value); });
}

void ConfigFields::operator()(const std::string& name, std::string& value, Need need) {
  visit(name, value, need, [&] { return reader_->text(name, value); });
}

void ConfigFields::operator()(const std::string& name, std::string& value, const std::vector<std::string>& words,
                              Need need) {
  visit(name, value, need, [&] { return reader_->choice(name, value, words); });
}

void ConfigFields::operator()(const std::string& name, std::filesystem::path& value, Need need) {
  std::string text = value.string();
  (*this)(name, text, need);
  value = text;
}

void ConfigFields::operator()(const std::string& name, std::vector<std::int64_t>& value, Need need) {
  visit(name, value, need, [&] { return reader_->integers(name, value); });
}

void ConfigFields::operator()(const std::string& name, std::vector<double>& value, Need need) {
  visit(name, value, need, [&] { return reader_->numbers(name, value); });
}

void ConfigFields::operator()(const std::string& name, std::vector<std::string>& value, Need need) {
  visit(name, value, need, [&] { return reader_->texts(name, value); });
}

void ConfigFields::or_null(const std::string& name, std::int64_t& value, FieldRange<std::int64_t> range) {
  if (null(name, value != 0)) {
    if (!reads() || reader_->has(name)) value = 0;
    return;
  }
  (*this)(name, value, range);
}

void ConfigFields::custom(const std::string& name, const Json& schema, const std::function<void(const Json&)>& read,
                          const std::function<Json()>& write) {
  if (writes()) {
    if (write) (*json_)[name] = write();
    return;
  }
  const Json* value = reader_->raw(name);
  if (ConfigRecord::current() != nullptr) ConfigRecord::current()->node(reader_->pointer_to(name)) = schema;
  if (value != nullptr) read(*value);
}

void ConfigFields::ignored(const std::string& name) {
  if (reads()) reader_->ignore(name);
}

void ConfigFields::unused(const std::string& name) {
  if (reads()) reader_->raw(name);
}

InputError ConfigFields::error(const std::string& name, const std::string& problem) const {
  return reads() ? reader_->error(name, problem) : InputError("", "/" + name, problem);
}

NotSupportedError ConfigFields::not_supported(const std::string& name, const std::string& feature) const {
  return reads() ? NotSupportedError(reader_->file(), reader_->pointer_to(name), feature)
                 : NotSupportedError("", "/" + name, feature);
}

void ConfigFields::nested(const std::string& name, const std::function<void(ConfigFields&)>& fields) {
  if (reads()) {
    ConfigReader below = reader_->object(name);
    ConfigFields inner(below);
    fields(inner);
    below.finish();
  } else {
    ConfigFields inner((*json_)[name] = Json::object());
    fields(inner);
  }
}

bool ConfigFields::null(const std::string& name, bool set) {
  if (reads()) {
    const Json* value = reader_->raw(name);
    return value == nullptr || value->is_null();
  }
  if (!set) (*json_)[name] = nullptr;
  return !set;
}

void OptionCheck::operator()(bool valid, const std::string& key, const std::string& problem) const {
  if (!valid) throw InputError(file, key.empty() ? pointer : pointer + "/" + key, problem);
}

void OptionCheck::heads(const std::string& key, std::int64_t heads, std::int64_t channels) const {
  (*this)(heads > 0 && channels % heads == 0, key,
          std::to_string(heads) + " heads do not divide " + std::to_string(channels) + " channels");
}

}  // namespace anigen
