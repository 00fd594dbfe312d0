-- ArduPilot's Lua bindings, made of the functions of an autopilot object (see lua_host.Autopilot).
--
-- Names, argument checks and nil returns as in libraries/AP_Scripting of Rover-4.6.3: generator/description/
-- bindings.desc (methods), lua_boxed_numerics.cpp (uint32_t), lua_bindings.cpp (logger:write),
-- lua/src/lbaselib.c (what the sandbox offers). Called with the autopilot's functions; returns the
-- globals of a script, and a function that runs one function under an instruction limit.

local autopilot, instruction_limit = ...
local MASK = 0xFFFFFFFF

---------------------------------------------------------------- uint32_t, Vector3f

local uint32_methods, uint32_meta = {}, {}

local function boxed(value)
    return setmetatable({ value & MASK }, uint32_meta)
end

-- coerce_to_uint32_t: a userdata, an integer (a negative one wraps), or a float within range.
local function coerce(value)
    if getmetatable(value) == uint32_meta then
        return value[1]
    end
    local integer = math.tointeger(value)
    if integer then
        return integer & MASK
    end
    if type(value) == "number" and value >= 0 and value <= MASK then
        return math.floor(value)
    end
    error("Unable to coerce to uint32_t", 3)
end

local function dividing(operation)
    return function(a, b)
        local divisor = coerce(b)
        if divisor == 0 then
            error("uint32_t divided by zero", 2)
        end
        return boxed(operation(coerce(a), divisor))
    end
end

uint32_meta.__index = uint32_methods
uint32_meta.__add = function(a, b) return boxed(coerce(a) + coerce(b)) end
uint32_meta.__sub = function(a, b) return boxed(coerce(a) - coerce(b)) end
uint32_meta.__mul = function(a, b) return boxed(coerce(a) * coerce(b)) end
uint32_meta.__div = dividing(function(a, b) return a // b end)
uint32_meta.__idiv = uint32_meta.__div
uint32_meta.__mod = dividing(function(a, b) return a % b end)
uint32_meta.__band = function(a, b) return boxed(coerce(a) & coerce(b)) end
uint32_meta.__bor = function(a, b) return boxed(coerce(a) | coerce(b)) end
uint32_meta.__bxor = function(a, b) return boxed(coerce(a) ~ coerce(b)) end
uint32_meta.__shl = function(a, b) return boxed(coerce(a) << coerce(b)) end
uint32_meta.__shr = function(a, b) return boxed(coerce(a) >> coerce(b)) end
uint32_meta.__bnot = function(a) return boxed(~coerce(a)) end
uint32_meta.__eq = function(a, b) return coerce(a) == coerce(b) end
uint32_meta.__lt = function(a, b) return coerce(a) < coerce(b) end
uint32_meta.__le = function(a, b) return coerce(a) <= coerce(b) end
uint32_meta.__tostring = function(a) return string.format("%d", a[1]) end

function uint32_methods:toint() -- a 32-bit integer: the upper half comes out negative
    return self[1] > 0x7FFFFFFF and self[1] - MASK - 1 or self[1]
end

function uint32_methods:tofloat() -- a single float, as on the vehicle
    return (string.unpack("f", string.pack("f", self[1])))
end

local vector_methods = {}
local vector_meta = { __index = vector_methods }
for index, axis in ipairs({ "x", "y", "z" }) do
    vector_methods[axis] = function(self, value)
        if value == nil then
            return self[index]
        end
        self[index] = value
    end
end

function vector_methods:length()
    return math.sqrt(self[1] * self[1] + self[2] * self[2] + self[3] * self[3])
end

local function vector(x, y, z)
    return setmetatable({ x or 0.0, y or 0.0, z or 0.0 }, vector_meta)
end

local function vector_or_nil(x, y, z)
    if x == nil then
        return nil
    end
    return vector(x, y, z)
end

---------------------------------------------------------------- argument checks

local function within(low, high)
    return function(value, position)
        local integer = math.tointeger(value)
        if not integer or integer < low or integer > high then
            error(string.format("bad argument #%d (argument out of range)", position), 4)
        end
        return integer
    end
end

local function number(value, position)
    if type(value) ~= "number" then
        error(string.format("bad argument #%d (number expected, got %s)", position, type(value)), 4)
    end
    return value
end

local function text(value, position)
    if type(value) == "number" then
        return tostring(value)
    end
    if type(value) ~= "string" then
        error(string.format("bad argument #%d (string expected, got %s)", position, type(value)), 4)
    end
    return value
end

local uint8, uint16 = within(0, 0xFF), within(0, 0xFFFF)
local aux_function, servo_function, servo_channel = uint16, within(0, 0xFF), within(0, 31)
local rc_channel, severity, table_key = within(1, 16), within(0, 7), within(0, 200)

-- A method of a singleton: called with a colon, with as many arguments as there are checks.
local function method(object, name, checks, call)
    object[name] = function(self, ...)
        local arguments = { ... }
        if self ~= object then
            error(string.format("bad argument #1 to '%s' (use a colon)", name), 2)
        end
        if select("#", ...) ~= #checks then
            error(string.format("%s expects %d arguments, got %d", name, #checks, select("#", ...)), 2)
        end
        for i, check in ipairs(checks) do
            arguments[i] = check(arguments[i], i + 1)
        end
        return call(table.unpack(arguments, 1, #checks))
    end
end

---------------------------------------------------------------- parameters

local param, tables = {}, {}

method(param, "get", { text }, autopilot.get_parameter)
method(param, "set", { text, number }, function(name, value)
    return autopilot.set_parameter(name, value, false)
end)
method(param, "set_and_save", { text, number }, function(name, value)
    return autopilot.set_parameter(name, value, true)
end)
method(param, "add_table", { table_key, text, within(1, 63) }, function(key, prefix, count)
    local known = tables[key]
    if known and (known.prefix ~= prefix or count > known.count) then
        return false
    end
    tables[key] = { prefix = prefix, count = count }
    return true
end)
method(param, "add_param", { table_key, within(1, 63), text, number }, function(key, index, name, default)
    local known = tables[key]
    if not known or index > known.count or #known.prefix + #name > 16 then
        return false
    end
    return autopilot.add_parameter(known.prefix .. name, default)
end)

local parameter_methods = {}
local parameter_meta = { __index = parameter_methods }

function parameter_methods:init(name)
    self.name = autopilot.get_parameter(name) ~= nil and name or nil
    return self.name ~= nil
end

function parameter_methods:get()
    return self.name and autopilot.get_parameter(self.name)
end

function parameter_methods:set(value)
    return self.name ~= nil and autopilot.set_parameter(self.name, number(value, 2), false)
end

function parameter_methods:set_and_save(value)
    return self.name ~= nil and autopilot.set_parameter(self.name, number(value, 2), true)
end

local function Parameter(name)
    local parameter = setmetatable({}, parameter_meta)
    if name ~= nil and not parameter:init(name) then
        error("No parameter: " .. name, 2)
    end
    return parameter
end

---------------------------------------------------------------- vehicle

local rc, arming, vehicle, servos, ahrs, gcs = {}, {}, {}, {}, {}, {}

method(rc, "get_pwm", { rc_channel }, autopilot.rc_pwm)
method(rc, "get_aux_cached", { aux_function }, autopilot.aux_position)
method(rc, "has_valid_input", {}, autopilot.rc_valid)

local channel_meta = { __index = {} }
function channel_meta.__index:set_override(pwm)
    autopilot.override_rc(self.number, within(0, 2200)(pwm, 2))
end

local function channel_object(number)
    return number and setmetatable({ number = number }, channel_meta)
end
method(rc, "get_channel", { rc_channel }, channel_object)
method(rc, "find_channel_for_option", { aux_function }, function(option)
    return channel_object(autopilot.rc_with_option(option))
end)

method(arming, "is_armed", {}, autopilot.armed)
method(arming, "disarm", {}, autopilot.disarm)
method(vehicle, "get_mode", {}, autopilot.mode)
method(vehicle, "set_mode", { uint8 }, autopilot.set_mode)

method(servos, "find_channel", { servo_function }, autopilot.servo_channel)
method(servos, "set_output_pwm_chan_timeout", { servo_channel, uint16, uint16 }, autopilot.override_servo)
method(servos, "get_output_pwm_chan", { servo_channel }, autopilot.servo_pwm)
method(servos, "get_output_pwm", { servo_function }, function(wanted)
    local channel = autopilot.servo_channel(wanted)
    return channel and autopilot.servo_pwm(channel)
end)

method(ahrs, "get_gyro", {}, function() return vector(autopilot.gyro()) end)
method(ahrs, "get_accel", {}, function() return vector(autopilot.accel()) end)
method(ahrs, "get_velocity_NED", {}, function() return vector_or_nil(autopilot.velocity_ned()) end)
for index, angle in ipairs({ "get_roll", "get_pitch", "get_yaw" }) do
    method(ahrs, angle, {}, function()
        local attitude = { autopilot.attitude() }
        return attitude[index]
    end)
end

method(gcs, "send_text", { severity, text }, autopilot.statustext)
method(gcs, "send_named_float", { text, number }, autopilot.named_float)
method(gcs, "last_seen", {}, function() return boxed(autopilot.gcs_last_seen_ms()) end)

---------------------------------------------------------------- log

local int16, int32 = within(-0x8000, 0x7FFF), within(-0x80000000, 0x7FFFFFFF)
local LOG_FORMATS = {
    b = within(-128, 127), B = uint8, M = uint8, h = int16, c = int16, H = uint16, C = uint16,
    i = int32, L = int32, e = int32, I = coerce, E = coerce, f = number, n = text, N = text, Z = text,
}

local function commas(labels)
    return select(2, labels:gsub(",", ",")) + 1
end

local function check_message(name, labels, format)
    if #name > 4 then
        error("Name must be 4 or less chars long", 3)
    end
    if #labels >= 58 then
        error("labels must be less than 58 chars long", 3)
    end
    if #format >= 16 then
        error("format must be less than 15 chars long", 3)
    end
    if #format ~= commas(labels) then
        error("label does not match format", 3)
    end
end

local logger = {}

function logger:write(name, labels, format, ...)
    check_message(name, labels, format)
    local values = { ... }
    local count, units, multipliers = select("#", ...), "", ""
    if count == #format + 2 then
        units, multipliers = table.remove(values, 1), table.remove(values, 1)
        if #units ~= #format or #multipliers ~= #format then
            error("units and multipliers must be same length as format", 2)
        end
    elseif count ~= #format then
        error("format does not match No. of arguments", 2)
    end
    for i = 1, #format do
        local check = LOG_FORMATS[format:sub(i, i)] or error("unknown format", 2)
        values[i] = check(values[i], i)
    end
    autopilot.log_write(name, labels, format, units, multipliers, table.unpack(values, 1, #format))
end

---------------------------------------------------------------- the script's globals, and running it

local globals = {
    assert = assert, error = error, ipairs = ipairs, next = next, pairs = pairs, pcall = pcall,
    setmetatable = setmetatable, tonumber = tonumber, tostring = tostring, type = type,
    math = math, table = table, string = string, utf8 = utf8,
    uint32_t = function(value) return boxed(coerce(value or 0)) end,
    Vector3f = vector, Parameter = Parameter,
    micros = function() return boxed(autopilot.micros()) end,
    millis = function() return boxed(autopilot.micros() // 1000) end,
    print = function(message) autopilot.statustext(6, tostring(message)) end,
    param = param, rc = rc, arming = arming, vehicle = vehicle, SRV_Channels = servos, ahrs = ahrs,
    gcs = gcs, logger = logger,
}

local function overtime()
    error("exceeded time limit", 2)
end

local function run(call)
    debug.sethook(overtime, "", instruction_limit)
    local results = table.pack(pcall(call))
    debug.sethook()
    return table.unpack(results, 1, results.n)
end

return globals, run
