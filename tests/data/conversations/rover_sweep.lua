--[[
Frequency sweep, doublets, multisine, or a sweep about a steering bias, on the steering of an ArduPilot rover
(4.5, 4.6), or a frequency sweep on its throttle, for identification.

Switch 6 (RC6_OPTION 300, or MAV_CMD_DO_AUX_FUNCTION 300) thrown high while armed in MANUAL starts a run:
  1 stand still for SWP_STILL s    2 the pilot brings the rover into SWP_V_MIN..SWP_V_MAX for 1 s
  3 straight    4 fade-in    5 dwell at SWP_WMIN    6 the law, SWP_TREC s    7 fade-out    8 straight
  9 stand still again for SWP_STILL s (steering is the pilot's)    10 stopped    0 idle
A doublet has 3, 6 and 8 only. A multisine runs on through 4, 5 and 7; its peak is searched for in 1 and 2, so
that it passes through 2 in any case. Steering is overridden in states 3 to 8 and nowhere else; the pilot
keeps the throttle throughout. Thrown while moving in the band with the stick centred, the switch leads
straight to 3 (a multisine: to 2).

A throttle sweep (SWP_TYPE 4) overrides the throttle in states 3 to 8 in the same way, about the throttle that
the pilot holds when 3 begins; the pilot keeps the steering. It never passes the motor's neutral PWM. Its stops
are those of the other runs, but it ends when the throttle stick moves, not the steering stick. With the stick
the motor is the pilot's again at the next main loop. It is logged as SWET, so nothing takes it for steering.

Switch low, disarm, any mode but MANUAL, RC or GCS loss, SWP_ENABLE 0, the steering stick moved, a limit
passed, another servo that steers, or this script paused for longer than its override lasts: the override
ends, and the main loop gives steering back to the pilot. If this script dies, the override runs out by
itself after OVERRIDE_MS. After a stop the switch must go low first; so it must after boot, after arming
and after a change of SWP_CHAN. A disarm and arm between two updates cannot be seen from Lua.

A ground station that overrides RC channels writes SWP_LAPSE [s] first, and before it SWP_THR [us] if it drives. While
SWP_LAPSE is not 0, RC_OVERRIDE_TIME has its value, but not in storage; what it was is kept in SWP_BACK and comes back.
One that drives moves the steering channel by a us or two with each message. If that does not come until 0.25 s before
the override is over, or not while it is disarmed and somebody then arms, or the throttle channel is neither at SWP_THR nor at its trim, or SWP_LAPSE is set to 0 while
armed, the ground station or its override is lost: the vehicle goes to HOLD (or disarms, if it cannot), before the
throttle stick has the motor. The pilot takes it back with the mode switch. A run that the pilot drives is never put
into HOLD.

One SWP_GO is one run: after a run for which the ground wrote a new SWP_GO, after a lost GCS, a paused script,
or a switch that may have fallen only because an override lapsed, no run begins until SWP_GO is written anew
or the pilot throws the switch high and low while no ground station can override it.

The waves are those of rover_sweep/identify/sweep.py and multisine.py. Numbers here are 32-bit integers and
single floats.
"Source" below is ArduPilot at Rover-4.6.3, with Rover-4.5.7 compared.
]]

local VERSION = "1.5"
local TABLE_KEY = 158 -- used by no script that ships with 4.5 or 4.6
local PREFIX = "SWP_"

-- Name, default, lowest, highest. The same table, with units and meaning, is in parameters.py.
local PARAMETERS = {
    { "ENABLE", 1, 0, 1 },
    { "TYPE", 0, 0, 4 },
    { "AMP", 150, 1, 500 },
    { "WMIN", 0.3, 0.05, 50 },
    { "WMAX", 25, 0.1, 100 },
    { "TREC", 55, 1, 600 },
    { "FADE", 2, 0, 20 },
    { "DWELL", 2, 0, 60 },
    { "STRAIGHT", 3, 0, 30 },
    { "STILL", 3, 0, 30 },
    { "PULSE", 1, 0.1, 10 },
    { "PAUSE", 2, 0, 30 },
    { "COUNT", 2, 1, 20 },
    { "PWM_MAX", 250, 1, 500 },
    { "ROLL_MAX", 30, 1, 90 },
    { "P_MAX", 200, 1, 2000 },
    { "R_MAX", 150, 1, 2000 },
    { "V_MIN", 0.5, 0, 30 },
    { "V_MAX", 4, 0.1, 50 },
    { "GCS", 0, 0, 1 },
    { "CHAN", 0, 0, 16 },
    { "RUN", 0, 0, 65535 },
    { "BIAS", 0, -400, 400 }, -- new ones at the end: the place in this table is the parameter's key
    { "GO", 0, 0, 65535 },
    { "THR", 0, 0, 2000 },
    { "LAPSE", 0, 0, 3 },
    { "BACK", 3, -1, 3600 },
    { "VER", 0, 0, 100 },
}

local PERIOD_MS = 10 -- gives 85 Hz on 4.5.7 and 4.6.3; 72 ms was the longest gap on an idle machine, at loop 50
local OVERRIDE_MS = 100 -- outlasts that gap; counted in main loops, rounded up (source: SRV_Channels.cpp)
local STEERING = 26 -- SERVOn_FUNCTION of ground steering
local AUX_FUNCTION = 300 -- RCx_OPTION Scripting1
local LOW, MIDDLE, HIGH = 0, 1, 2
local MANUAL = 0 -- elsewhere a controller would steer against the sweep and wind up behind it
local GCS_LOST_MS = 3000 -- two heartbeats at 1 Hz may be missed
local STILL_SPEED, MOVED_SPEED = 0.2, 0.4 -- m/s; an EKF on GPS wanders below the first when parked
local IN_BAND_S, STILL_TIMEOUT_S = 1.0, 30.0
local STICK_CENTRED_US, STICK_MOVED_US = 100, 200
local REPORT_US, IDLE_REPORT_US = 200000, 1000000
local CRITICAL, WARNING, INFO = 2, 4, 6
local UNKNOWN = 0.0 / 0.0

local IDLE, STILL_BEFORE, WAITING, STRAIGHT_BEFORE, FADE_IN = 0, 1, 2, 3, 4
local DWELL, LAW, FADE_OUT, STRAIGHT_AFTER, STILL_AFTER, STOPPED = 5, 6, 7, 8, 9, 10

---------------------------------------------------------------- what this firmware can do

local function say(severity, ...)
    gcs:send_text(severity, "SWP: " .. string.format(...))
end

-- The first call that is needed and not there, by name. A missing method reads as nil (source: generator).
local function missing_call()
    local needed = {
        { param, "param", "add_table", "add_param", "get", "set", "set_and_save" },
        { rc, "rc", "get_pwm", "get_aux_cached", "has_valid_input", "get_channel", "find_channel_for_option" },
        { arming, "arming", "is_armed", "disarm" },
        { vehicle, "vehicle", "get_mode", "set_mode" },
        { SRV_Channels, "SRV_Channels", "find_channel", "set_output_pwm_chan_timeout" },
        { ahrs, "ahrs", "get_gyro", "get_velocity_NED" },
        { logger, "logger", "write" },
    }
    for _, entry in ipairs(needed) do
        for i = 3, #entry do
            if not entry[1] or not entry[1][entry[i]] then
                return entry[2] .. ":" .. entry[i]
            end
        end
    end
    -- Either of two names will do. 4.5 and 4.6 have get_roll; get_roll_rad is its later name.
    if not (ahrs.get_roll or ahrs.get_roll_rad) then
        return "ahrs:get_roll"
    end
    -- get_output_pwm_chan is in 4.6, not in 4.5; get_output_pwm is in both.
    if not (SRV_Channels.get_output_pwm or SRV_Channels.get_output_pwm_chan) then
        return "SRV_Channels:get_output_pwm"
    end
    return nil
end

local function roll_rad()
    if ahrs.get_roll_rad then -- first: from 4.7 on a call of the old name forbids arming (seen on 4.8-dev)
        return ahrs:get_roll_rad()
    end
    return ahrs:get_roll()
end

-- NaN where that channel has lost its function: get_output_pwm would tell the PWM of another servo.
local function output_pwm(channel, servo)
    if SRV_Channels:find_channel(servo) ~= channel then
        return UNKNOWN
    elseif SRV_Channels.get_output_pwm then
        return SRV_Channels:get_output_pwm(servo) or UNKNOWN
    end
    return SRV_Channels:get_output_pwm_chan(channel) or UNKNOWN
end

---------------------------------------------------------------- the wave

-- In a block of its own: ArduPilot's Lua allows 100 local names at a time in the main chunk (source: lparser.c).
local MULTISINE, BIAS_SWEEP = 2, 3
local LEAST_LINES, MOST_LINES = 4, 128 -- odd lines of a multisine; each excited one costs a sine an update
local MANOEUVRES, odd_lines
do
    local C1, C2 = 4.0, 0.0187 -- Tischler & Remple 2012
    local LEFT_OUT = { 2, 1, 3, 2, 1, 2, 3, 1, 1, 3, 2, 2, 3, 1, 2, 1 } -- which of four odd lines is not excited
    local SINES = 250 -- in an update of the search for the peak: a third of SCR_VM_I_COUNT's default

    -- Frequency [rad/s] at s seconds into the law.
    local function sweep_rate(run, s)
        return run.WMIN + C2 * (math.exp(C1 * s / run.TREC) - 1.0) * (run.WMAX - run.WMIN)
    end

    -- Phase [rad] at law time t, in closed form; linear before the law and after it.
    local function sweep_phase(run, t)
        local s = math.max(0.0, math.min(t, run.TREC))
        local law = (run.WMAX - run.WMIN) * C2 * (run.TREC / C1 * (math.exp(C1 * s / run.TREC) - 1.0) - s)
        local after = sweep_rate(run, run.TREC) * math.max(t - run.TREC, 0.0)
        return run.WMIN * (s + math.min(t, 0.0)) + law + after
    end

    -- State, envelope and law time [s] at t seconds of override, for what fades in and out; a nil state: it is over.
    local function course(run, t)
        local lead = run.FADE + run.DWELL
        local since = t - run.STRAIGHT
        local left = lead + run.TREC + run.FADE - since
        local state, envelope = LAW, 1.0
        if since < 0 then
            state, envelope = STRAIGHT_BEFORE, 0.0
        elseif left <= 0 then
            state, envelope = left > -run.STRAIGHT and STRAIGHT_AFTER or nil, 0.0
        elseif since < run.FADE then
            state, envelope = FADE_IN, since / run.FADE
        elseif since < lead then
            state = DWELL
        elseif left < run.FADE then
            state, envelope = FADE_OUT, left / run.FADE
        end
        return state, envelope, since - lead
    end

    -- Offset [us] at full envelope and frequency [rad/s] of a sweep, s seconds into the law or before it.
    local function sweep(run, s)
        local phase = sweep_phase(run, s) + run.WMIN * (run.FADE + run.DWELL)
        return run.AMP * math.sin(phase), sweep_rate(run, math.max(0.0, math.min(s, run.TREC)))
    end

    -- The same about a bias, which fades in and out with it.
    local function bias_sweep(run, s)
        local offset, rate = sweep(run, s)
        return run.BIAS + offset, rate
    end

    -- The lowest and highest odd multiple of 2 pi COUNT / TREC from WMIN to WMAX, or a hundredth of it beyond.
    function odd_lines(v)
        local base = 2.0 * math.pi * v.COUNT / v.TREC
        local low, high = math.ceil(v.WMIN / base - 0.01), math.floor(v.WMAX / base + 0.01)
        return low + 1 - low % 2, high - 1 + high % 2
    end

    -- The excited lines, three of each four odd ones, and their phases [rad] (Schroeder 1970), added to the run.
    local function choose_lines(run)
        local low, high = odd_lines(run)
        local count = (high - low) // 2 + 1
        run.lines, run.phases, run.looked, run.peak = {}, {}, 0, 0.0
        for j = 0, count - 1 do
            if j % 4 ~= LEFT_OUT[j // 4 % #LEFT_OUT + 1] then
                run.lines[#run.lines + 1] = low + 2 * j
                run.phases[#run.phases + 1] = -math.pi * (j * j % (2 * count)) / count
            end
        end
    end

    -- Whether the peak of the sum of sines is known; looks at some more of the half period that repeats with its
    -- sign changed. 16 points a period of the highest line miss the peak by 2 % at most.
    local function find_peak(run)
        if not run.lines then
            choose_lines(run)
        end
        local half = 8 * run.lines[#run.lines]
        local stop = math.min(half, run.looked + SINES // #run.lines)
        for i = run.looked, stop - 1 do
            local sum = 0.0
            for n = 1, #run.lines do
                sum = sum + math.sin(math.pi * (run.lines[n] * i % (2 * half)) / half + run.phases[n])
            end
            run.peak = math.max(run.peak, math.abs(sum))
        end
        run.looked = stop
        return stop == half
    end

    -- Offset [us] at full envelope of a multisine of peak AMP and COUNT periods in TREC; it has no one frequency.
    local function multisine(run, s)
        local turned = 2.0 * math.pi * (s * run.COUNT / run.TREC % 1.0)
        local sum = 0.0
        for n = 1, #run.lines do
            sum = sum + math.sin(run.lines[n] * turned + run.phases[n])
        end
        return run.AMP * sum / run.peak, 0.0
    end

    -- State, offset [us] and frequency [rad/s] at t seconds of override of such a law; a nil state: it is over.
    local function faded(law)
        return function(run, t)
            local state, envelope, s = course(run, t)
            if envelope == 0.0 then
                return state, 0.0, 0.0
            end
            local offset, rate = law(run, s)
            return state, envelope * offset, rate
        end
    end

    -- The same for doublets: +AMP and -AMP for PULSE s each, PAUSE s apart, COUNT times.
    local function doublet(run, t)
        local since = t - run.STRAIGHT
        local period = 2.0 * run.PULSE + run.PAUSE
        if since < 0 then
            return STRAIGHT_BEFORE, 0.0, 0.0
        elseif since >= run.COUNT * period then
            return since < run.COUNT * period + run.STRAIGHT and STRAIGHT_AFTER or nil, 0.0, 0.0
        end
        local into = since % period
        if into < run.PULSE then
            return LAW, run.AMP, 0.0
        elseif into < 2.0 * run.PULSE then
            return LAW, -run.AMP, 0.0
        end
        return LAW, 0.0, 0.0
    end

    MANOEUVRES = {
        [0] = { name = "sweep", at = faded(sweep) },
        [1] = { name = "doublet", at = doublet },
        [MULTISINE] = { name = "multisine", at = faded(multisine), prepared = find_peak },
        [BIAS_SWEEP] = { name = "bias sweep", at = faded(bias_sweep) },
        -- `prepared`: never straight from the switch, as the stick has to be held for a second first
        [4] = { name = "throttle sweep", at = faded(sweep), prepared = function() return true end },
    }
end

---------------------------------------------------------------- what is seen

local parameter = {} -- name without prefix -> Parameter
local state = IDLE
local entered = uint32_t(0) -- micros() when the state began
local run = nil -- the parameters of the run, copied at the switch, and what the run remembers
local ready = false -- the switch has been low since boot, arming, the last run
local last_source = false -- none looked at yet; nil is an impossible SWP_CHAN
local was_armed = false
local last_report = uint32_t(0)

-- Seconds since `earlier`; uint32_t differences are right across the wrap after 71 minutes.
local function seconds_since(earlier)
    return (micros() - earlier):tofloat() * 1e-6
end

-- An RC channel, or 0, as a whole number; nil for -1, 17, 1e20 or NaN: rc:get_pwm and "%d" survive none of them.
local function channel_number(value)
    return value >= 0 and value <= 16 and math.floor(value) or nil
end

-- LOW, MIDDLE, HIGH or nil where nothing is known. Thresholds of read_3pos_switch (source: RC_Channel.cpp).
local function switch_position(source)
    if source == 0 then
        return rc:get_aux_cached(AUX_FUNCTION)
    elseif not source then
        return nil
    end
    local pwm = rc:get_pwm(source)
    if not pwm or pwm <= 800 or pwm >= 2200 then
        return nil
    elseif pwm < 1200 then
        return LOW
    end
    return pwm > 1800 and HIGH or MIDDLE
end

-- Milliseconds since the ground station was heard. last_seen is read first: it may move on meanwhile.
local function gcs_age_ms()
    local heard = gcs:last_seen()
    return (millis() - heard):tofloat()
end

-- Everything that decides about a run, read once an update.
local function look(source)
    local velocity, gyro = ahrs:get_velocity_NED(), ahrs:get_gyro()
    local vn, ve = UNKNOWN, UNKNOWN -- logged as NaN while the EKF has no velocity
    if velocity then
        vn, ve = velocity:x(), velocity:y()
    end
    local speed = math.sqrt(vn * vn + ve * ve)
    return {
        switch = switch_position(source),
        armed = arming:is_armed(),
        mode = vehicle:get_mode(),
        rc_valid = rc:has_valid_input(), -- false in the throttle failsafe (source: Rover/RC_Channel.cpp)
        gcs_age_ms = gcs.last_seen and gcs_age_ms(),
        roll = math.deg(roll_rad()),
        p = math.deg(gyro:x()),
        r = math.deg(gyro:z()),
        vn = vn,
        ve = ve,
        speed = speed == speed and speed or nil, -- nil where the EKF's velocity is NaN, too
    }
end

---------------------------------------------------------------- who may begin a run

-- From Lua an override of the switch looks like the pilot's own radio. It holds for RC_OVERRIDE_TIME after the
-- ground station was last heard (source: RC_Channel::has_override), so what is seen later is the pilot's.
local go = {
    used = nil, -- SWP_GO of the last run, or as it was when this script started
    locked_by = nil, -- number of the run after which no other begins
    high = false, -- the pilot's own switch was seen high since
    LATE_MS = 1500, -- a ground station sends overrides several times a second
    MARGIN_MS = 1000, -- last_seen may be older than the last override
}

-- How long an override may hold [ms]; nil where it never ends (RC_OVERRIDE_TIME below 0).
function go.lapse_ms()
    local seconds = param:get("RC_OVERRIDE_TIME") or 3.0
    return seconds >= 0 and 1000.0 * seconds or nil
end

-- Whether the switch that is seen now can only be the pilot's.
function go.is_pilots(seen)
    local lapse = go.lapse_ms()
    return lapse and seen.gcs_age_ms and seen.gcs_age_ms > lapse + go.MARGIN_MS
end

-- Whether a switch that goes low now may be an override that lapsed.
function go.may_have_lapsed(seen)
    local lapse = go.lapse_ms()
    return lapse and seen.gcs_age_ms and seen.gcs_age_ms > math.min(go.LATE_MS, 0.8 * lapse)
        and not go.is_pilots(seen)
end

-- Unlocked by the pilot: high, then low, while only his radio moves the switch.
function go.watch(seen)
    if not go.locked_by or not go.is_pilots(seen) then
        go.high = false
    elseif seen.switch == HIGH then
        go.high = true
    elseif seen.switch == LOW and go.high then
        go.locked_by, go.high = nil, false
    end
end

-- Why these parameters begin no run, or nil.
function go.refuse(values)
    if go.locked_by and values.GO == go.used then
        return string.format("after run %d, needs a new SWP_GO", go.locked_by)
    end
    return nil
end

-- From now on a run needs an SWP_GO that is written later: overrides begin or end, and beneath them the pilot's own
-- switch may be high.
function go.lock()
    go.used, go.locked_by, go.high = parameter.GO:get(), go.locked_by or parameter.RUN:get(), false
end

-- A run begins with this SWP_GO.
function go.take(values)
    values.asked = values.GO ~= go.used
    go.used, go.locked_by, go.high = values.GO, nil, false
end

-- The run ends, whole or for this reason.
function go.ended(ended, seen, reason)
    local lapsed = reason == "switch low" and go.may_have_lapsed(seen)
    local unattended = reason == "GCS lost" or reason and string.find(reason, "^script paused")
    if ended.asked or unattended or lapsed then
        go.locked_by, go.high = ended.number, false
    end
end

---------------------------------------------------------------- a ground station that overrides

local laptop = {
    on = false, -- SWP_LAPSE was written and is in force
    seen = nil, -- value of the steering channel [us], which moved at `moved`
    moved = uint32_t(0),
    meddled = nil, -- RC_OVERRIDE_TIME as somebody else set it meanwhile
    time = nil, -- the parameter RC_OVERRIDE_TIME; before: its value before
    gone = nil, -- when it went silent while disarmed: who arms soon after did not know
    ghost = nil, -- throttle [us] of one that is lost: what a slow link delivers later is given back at once
    GONE_S = 60.0,
    GHOST_S = 1.5, -- longer than the firmware needs to miss a radio, which an override given back conceals
    OWN = { THR = true, LAPSE = true, BACK = true, VER = true }, -- parameters that belong to no run
    MARGIN_S = 0.25, -- HOLD comes so long before the override is over; an update may be 72 ms late
    HOLD = 4, -- mode
}

-- The RC channel that a parameter names.
function laptop.channel(name, usual)
    local number = channel_number(param:get(name) or usual)
    return number and number >= 1 and number or usual
end

-- Its overrides begin. What they lapse after is set in RAM only, so a reboot has the old value as well. resumed:
-- this script starts while they are in force, so that SWP_BACK has the old value already.
function laptop.enter(lapse, resumed)
    laptop.time = laptop.time or Parameter("RC_OVERRIDE_TIME")
    local now = laptop.time:get()
    go.lock()
    laptop.on, laptop.lapse, laptop.meddled, laptop.moved = true, lapse, nil, micros()
    laptop.gone, laptop.ghost = nil, nil
    laptop.map = param:get("RCMAP_THROTTLE") and Parameter("RCMAP_THROTTLE") -- takes effect at once
    laptop.thr = parameter.THR:get() -- what somebody else writes there later does not count
    laptop.steering, laptop.throttle = laptop.channel("RCMAP_ROLL", 1), laptop.channel("RCMAP_THROTTLE", 3)
    laptop.rest = param:get(string.format("RC%d_TRIM", laptop.throttle)) or 1500
    local switch = channel_number(parameter.CHAN:get()) or 0
    laptop.channels = { rc:get_channel(laptop.throttle), rc:get_channel(laptop.steering) }
    laptop.channels[3] = switch > 0 and rc:get_channel(switch) or rc:find_channel_for_option(AUX_FUNCTION)
    laptop.before = resumed and now == lapse and parameter.BACK:get() or now
    parameter.BACK:set_and_save(laptop.before)
    laptop.time:set(lapse)
    laptop.missed = param:get("RC_FS_TIMEOUT") -- since 4.7; before it is 0.5 s
    if laptop.missed and laptop.missed > 0.5 then
        param:set("RC_FS_TIMEOUT", 0.5)
    end
    gcs:send_named_float("SWP_THR", laptop.thr)
end

-- No override of its channels holds any longer.
function laptop.give_back()
    for _, channel in ipairs(laptop.channels) do
        channel:set_override(0)
    end
    laptop.given = micros()
end

-- They are over, for whatever reason: none of them holds any longer, whatever RC_OVERRIDE_TIME is then.
function laptop.leave()
    go.lock()
    laptop.give_back()
    laptop.time:set(laptop.before)
    if laptop.missed then
        param:set("RC_FS_TIMEOUT", laptop.missed)
    end
    parameter.LAPSE:set_and_save(0)
    parameter.THR:set_and_save(0)
    laptop.on = false
    gcs:send_named_float("SWP_THR", 0)
end

-- Whoever sets RC_OVERRIDE_TIME meanwhile gets it afterwards; until then it would outlast the ground station.
function laptop.hold_lapse()
    local now = laptop.time:get()
    if math.abs(now - laptop.lapse) > 0.001 then
        laptop.meddled, laptop.before = now, now
        parameter.BACK:set_and_save(now)
        laptop.time:set(laptop.lapse)
    end
    if parameter.THR:get() ~= laptop.thr then -- so that this script, started again, still knows
        parameter.THR:set_and_save(laptop.thr)
    end
end

-- Why the ground station or its override is lost, or nil. One that drives shows itself on the steering channel,
-- so another station with its id, or RC_OVERRIDE_TIME, cannot stand in for it; and it disarms before it leaves.
function laptop.lost(seen)
    if not (parameter.LAPSE:get() > 0) then
        return "it left"
    elseif laptop.thr == 0 then
        return seen.gcs_age_ms and seen.gcs_age_ms > 1000.0 * laptop.lapse and "silent" or nil
    end
    if laptop.map and laptop.map:get() ~= laptop.throttle then
        return "RCMAP"
    end
    local steering, throttle = rc:get_pwm(laptop.steering), rc:get_pwm(laptop.throttle)
    if steering ~= laptop.seen then
        laptop.seen, laptop.moved = steering, micros()
    elseif not (seconds_since(laptop.moved) <= laptop.lapse - laptop.MARGIN_S) then
        return "silent"
    end
    if seen.armed and throttle ~= laptop.rest and throttle ~= laptop.thr then
        return string.format("thr %d us", throttle or 0)
    end
    return nil
end

-- HOLD stops the motor and centres the steering whatever the sticks say, and the log goes on; the pilot can drive
-- the rover home. It needs no position (source: mode_hold.cpp) and comes at once, in 4.5.7, 4.6.3 and 4.8-dev.
function laptop.stop_vehicle(reason)
    vehicle:set_mode(laptop.HOLD)
    local held = vehicle:get_mode() == laptop.HOLD
    if not held then
        arming:disarm()
    end
    say(CRITICAL, "laptop lost (%s): %s", reason, held and "HOLD" or "disarmed")
    if held then
        say(CRITICAL, "the mode switch gives you the rover")
    end
end

-- What is done while nobody is watched. true: the vehicle was stopped.
function laptop.after(seen)
    local throttle = laptop.ghost and rc:get_pwm(laptop.throttle)
    if throttle and throttle == laptop.ghost
        and (laptop.seen ~= throttle or seconds_since(laptop.given) > laptop.GHOST_S) then
        laptop.give_back()
    end
    laptop.seen = throttle
    if laptop.gone and seconds_since(laptop.gone) > laptop.GONE_S then
        laptop.gone = nil
    elseif laptop.gone and seen.armed then
        laptop.stop_vehicle("silent")
        laptop.gone = nil
        return true
    end
    return false
end

-- Looks after all this; the reason, when the vehicle was stopped because the laptop is lost.
function laptop.watch(seen)
    local lapse = parameter.LAPSE:get()
    if lapse > 0 and not laptop.on then
        if seen.armed and parameter.THR:get() ~= 0 then -- it drives only what it armed itself
            parameter.LAPSE:set_and_save(0)
            say(WARNING, "refused: SWP_LAPSE while armed")
        else
            laptop.enter(math.min(lapse, 3.0))
        end
    end
    if not laptop.on then
        return laptop.after(seen) and "laptop lost: silent" or nil
    end
    laptop.hold_lapse()
    local reason, drives = laptop.lost(seen), laptop.thr ~= 0
    local stops = reason and seen.armed and drives
    if stops then
        laptop.stop_vehicle(reason)
    end
    if reason then
        laptop.leave()
        laptop.ghost = drives and laptop.thr or nil
        laptop.gone = drives and not seen.armed and reason == "silent" and micros() or nil
    end
    return stops and "laptop lost: " .. reason or nil
end

---------------------------------------------------------------- refusing and stopping

local function read_parameters()
    local values = {}
    for _, p in ipairs(PARAMETERS) do
        values[p[1]] = parameter[p[1]]:get()
    end
    return values
end

-- Middle of the wave [us] from trim.
local function middle(v)
    return v.TYPE == BIAS_SWEEP and v.BIAS or 0.0
end

-- Why there is no such multisine, or nil.
local function refuse_lines(v)
    local low, high = odd_lines(v)
    local count = (high - low) // 2 + 1
    if v.COUNT < 2 or v.COUNT % 1 ~= 0 then
        return string.format("SWP_COUNT %g is not 2, 3..", v.COUNT)
    elseif not (count >= LEAST_LINES and count <= MOST_LINES) then
        return string.format("%d odd lines, not %d to %d", count, LEAST_LINES, MOST_LINES)
    end
    return nil
end

-- Why these parameters cannot be driven, or nil. `not (a <= b)` refuses NaN as well.
local function refuse_parameters(v)
    for _, p in ipairs(PARAMETERS) do
        if not laptop.OWN[p[1]] and not (v[p[1]] >= p[3] and v[p[1]] <= p[4]) then
            return string.format("SWP_%s %g outside %g to %g", p[1], v[p[1]], p[3], p[4])
        end
    end
    if not MANOEUVRES[v.TYPE] then
        return string.format("SWP_TYPE %g is unknown", v.TYPE)
    elseif v.AMP > v.PWM_MAX then
        return string.format("SWP_AMP %g > SWP_PWM_MAX %g", v.AMP, v.PWM_MAX)
    elseif v.AMP + math.abs(middle(v)) > v.PWM_MAX then
        return string.format("AMP + BIAS %g > SWP_PWM_MAX %g", v.AMP + math.abs(middle(v)), v.PWM_MAX)
    elseif v.WMIN >= v.WMAX then
        return string.format("SWP_WMIN %g >= SWP_WMAX %g", v.WMIN, v.WMAX)
    elseif v.V_MIN >= v.V_MAX then
        return string.format("SWP_V_MIN %g >= SWP_V_MAX %g", v.V_MIN, v.V_MAX)
    elseif v.GCS > 0 and not gcs.last_seen then
        return "SWP_GCS 1, but no gcs:last_seen"
    end
    return v.TYPE == MULTISINE and refuse_lines(v) or nil
end

-- What a run overrides: SERVOn_FUNCTION, words, the RC channel of its stick [us from where it may be], log message.
local AXES = {
    steering = { servo = STEERING, name = "steering", lost = "steers", map = "RCMAP_ROLL", usual = 1, moved = STICK_MOVED_US, message = "SWEP" },
    -- a small movement of the throttle stick must stop: full stop may be 80 us away
    throttle = { servo = 70, name = "throttle", lost = "drives", map = "RCMAP_THROTTLE", usual = 3, held = 20, moved = 50, message = "SWET" },
}

-- Where the servo is and what it may do, added to the run; or why not.
local function refuse_servo(v)
    v.axis = v.TYPE == 4 and AXES.throttle or AXES.steering
    v.servo = v.axis.servo
    local channel = SRV_Channels:find_channel(v.servo)
    if not channel then
        return string.format("no servo has function %d (%s)", v.servo, v.axis.name)
    end
    local name = string.format("SERVO%d_", channel + 1)
    local trim, low, high = param:get(name .. "TRIM"), param:get(name .. "MIN"), param:get(name .. "MAX")
    if not (trim and low and high) then
        return name .. "TRIM, MIN, MAX unknown"
    end
    v.channel, v.trim = channel, trim
    if v.axis.held then -- its middle is not known before the pilot drives: AXES.hold
        v.neutral, v.least, v.most = trim, low, high
        return nil
    end
    local centre = trim + middle(v) -- a bias sweep begins and ends at the trim
    if not (math.min(trim, centre - v.AMP) >= low and math.max(trim, centre + v.AMP) <= high) then
        return string.format("PWM %g+-%g not in %g..%g", centre, v.AMP, low, high)
    end
    v.low, v.high = math.max(low, trim - v.PWM_MAX), math.min(high, trim + v.PWM_MAX)
    return nil
end

-- The middle of a throttle sweep, which the pilot holds now, and its limits, added to the run; or why not.
-- It stays on his side of neutral: no sweep drives a rover backwards, or brakes with the motor.
function AXES.hold(v)
    local centre = output_pwm(v.channel, v.servo)
    local low, high = v.neutral, v.most
    if centre < v.neutral then
        low, high = v.least, v.neutral
    end
    if not (centre - v.AMP >= low and centre + v.AMP <= high) then
        return string.format("%.0f+-%g not in %g..%g", centre, v.AMP, low, high)
    end
    v.trim = centre
    v.low, v.high = math.max(low, centre - v.PWM_MAX), math.min(high, centre + v.PWM_MAX)
    return nil
end

-- Where the pilot's stick is, added to the run; or why not.
local function refuse_stick(v)
    v.stick_channel = channel_number(param:get(v.axis.map) or v.axis.usual)
    if not v.stick_channel or v.stick_channel < 1 then
        return v.axis.map .. " outside 1 to 16"
    end
    v.stick_trim = param:get(string.format("RC%d_TRIM", v.stick_channel)) or 1500
    return nil
end

-- Why the vehicle may not start a run, or nil.
local function refuse_vehicle(v, seen)
    if not (v.ENABLE >= 1) then
        return string.format("SWP_ENABLE is %g", v.ENABLE)
    elseif not seen.armed then
        return "not armed"
    elseif seen.mode ~= MANUAL then
        return string.format("mode %d, needs MANUAL", seen.mode)
    elseif not seen.rc_valid then
        return "no RC"
    elseif not seen.speed then
        return "no velocity estimate"
    end
    return nil
end

-- Steering stick from its trim, throttle stick from where it was held [us]; NaN where the channel has no value.
local function stick_off(v)
    local stick = rc:get_pwm(v.stick_channel)
    return stick and math.abs(stick - v.stick_trim) or UNKNOWN
end

-- "roll 31.0 > 30 deg". A value that is not a number has passed every limit, so all are asked as not (a <= b).
local function over(name, value, limit, unit)
    return value == value and string.format("%s %.1f > %g %s", name, value, limit, unit) or name .. " unknown"
end

-- Why a run must end at once, or nil. One condition a line: the tests take each line out in turn.
local function reason_to_stop(v, seen)
    if seen.switch ~= HIGH then return "switch low" end
    if not seen.armed then return "disarmed" end
    if seen.mode ~= MANUAL then return string.format("mode %d, not MANUAL", seen.mode) end
    if not seen.rc_valid then return "RC lost" end
    if v.GCS > 0 and not (seen.gcs_age_ms <= GCS_LOST_MS) then return "GCS lost" end
    if not (parameter.ENABLE:get() >= 1) then return string.format("SWP_ENABLE is %g", parameter.ENABLE:get()) end
    if laptop.on and laptop.meddled then return string.format("RC_OVERRIDE_TIME set to %g", laptop.meddled) end
    if SRV_Channels:find_channel(v.servo) ~= v.channel then return string.format("SERVO%d %s no more", v.channel + 1, v.axis.lost) end
    return nil
end

-- The same for what matters only while this script steers, or is about to. The output is the pilot's until then.
local function limit_passed(v, seen)
    local off, roll, p, r = math.abs(output_pwm(v.channel, v.servo) - v.trim), math.abs(seen.roll), math.abs(seen.p), math.abs(seen.r)
    if v.steered and not (off <= v.PWM_MAX) then return over(v.axis.name, off, v.PWM_MAX, "us") end
    if not (stick_off(v) <= v.axis.moved) then return v.axis.name .. " stick moved" end
    if not (roll <= v.ROLL_MAX) then return over("roll", roll, v.ROLL_MAX, "deg") end
    if not (p <= v.P_MAX) then return over("roll rate", p, v.P_MAX, "deg/s") end
    if not (r <= v.R_MAX) then return over("yaw rate", r, v.R_MAX, "deg/s") end
    if not seen.speed then return "no velocity estimate" end
    if seen.speed and not (seen.speed <= v.V_MAX) then return over("speed", seen.speed, v.V_MAX, "m/s") end
    if seen.speed and not (seen.speed >= v.V_MIN) then return string.format("speed %.1f < %g m/s", seen.speed, v.V_MIN) end
    return nil
end

---------------------------------------------------------------- acting and telling

local whole -- number of the last run that came to its end

local function report(rate)
    gcs:send_named_float("SWP_ST", state)
    gcs:send_named_float("SWP_W", rate)
    gcs:send_named_float("SWP_RUN", run and run.number or parameter.RUN:get())
    if run then
        gcs:send_named_float("SWP_GO", run.GO) -- whose run it is
    end
    if laptop.on then
        gcs:send_named_float("SWP_THR", laptop.thr) -- who is watched
    end
    if whole and (state == IDLE or state == STOPPED) then
        gcs:send_named_float("SWP_DONE", whole)
    end
    last_report = micros()
end

local function enter(new_state, rate)
    state, entered = new_state, micros()
    report(rate or 0.0)
end

-- One SWEP or SWET message. `wanted` is the PWM before rounding; where the pilot steers there is no wish but his.
local function log(seen, t, wanted)
    local out = output_pwm(run.channel, run.servo)
    logger:write(run.axis.message, "Run,St,T,Cmd,Out,VN,VE", "HBfffff", "--sYYnn", "--00000",
        run.number, state, t, wanted or out, out, seen.vn, seen.ve)
end

-- The only line that moves anything. An override works disarmed too (measured), hence the last look.
local function override(pwm, timeout_ms)
    if arming:is_armed() then
        SRV_Channels:set_output_pwm_chan_timeout(run.channel, math.floor(pwm + 0.5), timeout_ms)
    end
end

-- The firmware does not hold an override within SERVOn_MIN..MAX (source: set_output_pwm with force), so it is done here.
local function steer(pwm)
    override(math.max(run.low, math.min(run.high, pwm)), OVERRIDE_MS)
end

local function overriding()
    return state >= STRAIGHT_BEFORE and state <= STRAIGHT_AFTER
end

-- Steering is the pilot's at the next main loop: a timeout of 0 lets calc_pwm recompute the output
-- (source: SRV_Channels.cpp; seen within one loop on 4.5.7 and 4.6.3). Disarmed, nothing is sent and the
-- last override runs out (seen after 90 to 100 ms), but a motor is set to neutral. A servo that steers no more
-- is left at trim, a motor at neutral.
local function release()
    local out, rest = output_pwm(run.channel, run.servo), run.neutral or run.trim
    override(out == out and out or rest, 0)
    if run.neutral and not arming:is_armed() then
        SRV_Channels:set_output_pwm_chan_timeout(run.channel, math.floor(run.neutral + 0.5), 0)
    end
end

local function stop(seen, reason)
    if overriding() then
        release()
    end
    say(WARNING, "run %d stopped: %s", run.number, reason)
    go.ended(run, seen, reason)
    enter(STOPPED)
    log(seen, run.time, nil)
end

local function done(seen)
    say(INFO, "run %d done", run.number)
    go.ended(run, seen, nil)
    whole = run.number
    enter(IDLE)
    run = nil
end

---------------------------------------------------------------- the course of a run

-- Nothing goes out before the limits were looked at: one override alone holds for OVERRIDE_MS.
local function start_override(seen)
    local reason = limit_passed(run, seen)
    if not reason and run.neutral then
        reason = AXES.hold(run)
    end
    if reason then
        stop(seen, reason)
        return
    end
    run.start = micros()
    say(INFO, "run %d start %s", run.number, run.manoeuvre.name)
    enter(STRAIGHT_BEFORE)
end

local function wait_for_speed()
    say(INFO, "run %d drive at %g to %g m/s", run.number, run.V_MIN, run.V_MAX)
    run.in_band = nil
    enter(WAITING)
end

local function in_band(seen)
    return seen.speed and seen.speed >= run.V_MIN and seen.speed <= run.V_MAX
end

-- A run does not start against a stick that is held off centre; the pilot is told once.
local function stick_centred()
    if run.neutral then -- a throttle stick has to be held where it is
        local held = stick_off(run) <= run.axis.held
        run.stick_trim = held and run.stick_trim or rc:get_pwm(run.stick_channel) or UNKNOWN
        return held
    end
    if stick_off(run) <= STICK_CENTRED_US then
        return true
    elseif not run.asked_for_centre then
        run.asked_for_centre = true
        say(INFO, "run %d waits for a centred steering stick", run.number)
    end
    return false
end

local function begin(seen)
    local values = read_parameters()
    local refusal = refuse_vehicle(values, seen) or refuse_parameters(values) or refuse_servo(values)
        or refuse_stick(values) or reason_to_stop(values, seen) or go.refuse(values)
    if refusal then
        say(WARNING, "refused: %s", refusal)
        return
    end
    go.take(values)
    run = values
    run.manoeuvre, run.time = MANOEUVRES[run.TYPE], 0.0
    run.number = math.floor(run.RUN) % 65535 + 1
    parameter.RUN:set_and_save(run.number)
    if run.STILL > 0 and seen.speed < STILL_SPEED then
        say(INFO, "run %d stand still for %g s", run.number, run.STILL)
        enter(STILL_BEFORE)
        return
    end
    if run.STILL > 0 then
        say(INFO, "run %d moving: no standstill in the record", run.number)
    end
    if in_band(seen) and stick_centred() and not run.manoeuvre.prepared then
        start_override(seen)
    else
        wait_for_speed()
    end
end

local function idle(seen)
    if seen.switch == LOW then
        ready = true
    elseif seen.switch == HIGH and ready then
        ready = false
        begin(seen)
    end
end

-- Whether the wave can begin; called while nothing is steered, each call does a little of what is to be done.
local function prepared()
    return not run.manoeuvre.prepared or run.manoeuvre.prepared(run)
end

local function stand_before(seen)
    if seen.speed and seen.speed > MOVED_SPEED then
        say(INFO, "run %d standstill only %.1f s", run.number, seconds_since(entered))
        wait_for_speed()
    elseif seconds_since(entered) >= run.STILL then
        wait_for_speed()
    end
end

local function wait(seen)
    local can_begin = prepared()
    if not (in_band(seen) and stick_centred()) then
        run.in_band = nil
    elseif not run.in_band then
        run.in_band = micros()
    elseif seconds_since(run.in_band) >= IN_BAND_S and can_begin then
        start_override(seen)
    end
end

local function stand_after(seen)
    if not seen.speed or seen.speed > STILL_SPEED then
        run.still_since = nil
    elseif not run.still_since then
        run.still_since = micros()
    end
    local stood = run.still_since and seconds_since(run.still_since) >= run.STILL
    if stood or seen.switch ~= HIGH or not seen.armed then
        done(seen)
    elseif seconds_since(entered) > STILL_TIMEOUT_S then
        say(INFO, "run %d no standstill at the end", run.number)
        done(seen)
    end
end

local function end_override(seen)
    release()
    if run.STILL > 0 then
        say(INFO, "run %d %s is yours: stop", run.number, run.axis.name)
        enter(STILL_AFTER)
    else
        done(seen)
    end
end

-- One step of the override: the wave at this very moment, on the servo and in the log. After a pause in which
-- the last one ran out the pilot has been steering, and steering is not taken from him in the middle of a wave.
local function drive(seen)
    local paused = run.steered and 1000.0 * seconds_since(run.steered) or 0.0
    if not (paused <= OVERRIDE_MS) then
        stop(seen, string.format("script paused %.0f ms", paused))
        return
    end
    local t = seconds_since(run.start)
    local next_state, offset, rate = run.manoeuvre.at(run, t)
    run.time = t
    if not next_state then
        end_override(seen)
        return
    end
    if next_state ~= state then
        enter(next_state, rate)
    end
    run.rate = rate
    local wanted = run.trim + offset
    run.steered = micros()
    steer(wanted)
    log(seen, t, wanted)
end

local function follow(seen)
    local reason = reason_to_stop(run, seen)
    if not reason and overriding() then
        reason = limit_passed(run, seen)
    end
    if reason then
        stop(seen, reason)
        return
    end
    if state == STILL_BEFORE then
        prepared()
        stand_before(seen)
    elseif state == WAITING then
        wait(seen)
    end
    if overriding() then
        drive(seen)
    elseif state ~= STOPPED then
        log(seen, 0.0, nil)
    end
end

-- A switch that is already high at boot, at arming or where SWP_CHAN now points is not a throw.
local function watch_switch(source, armed)
    if source ~= last_source or armed ~= was_armed then
        ready = false
    end
    if source ~= last_source and not source then
        say(WARNING, "refused: SWP_CHAN %g outside 0 to 16", parameter.CHAN:get())
    end
    last_source, was_armed = source, armed
end

local function update()
    local source = channel_number(run and run.CHAN or parameter.CHAN:get())
    local seen = look(source)
    watch_switch(source, seen.armed)
    go.watch(seen)
    local lost = laptop.watch(seen)
    if lost and state > IDLE and state < STILL_AFTER then
        stop(seen, lost)
    end
    if state == IDLE then
        idle(seen)
        if overriding() then
            drive(seen)
        end
    elseif state == STOPPED then
        if seen.switch ~= HIGH then
            enter(IDLE)
            run = nil
        end
    elseif state == STILL_AFTER then
        log(seen, run.time + seconds_since(entered), nil)
        stand_after(seen)
    else
        follow(seen)
    end
    if (micros() - last_report):tofloat() >= (state == IDLE and IDLE_REPORT_US or REPORT_US) then
        report(overriding() and run.rate or 0.0)
    end
    return update, PERIOD_MS
end

---------------------------------------------------------------- start

local function add_parameters()
    if not param:add_table(TABLE_KEY, PREFIX, #PARAMETERS) then
        return string.format("parameter table %d is taken", TABLE_KEY)
    end
    for i, p in ipairs(PARAMETERS) do
        if not param:add_param(TABLE_KEY, i, p[1], p[2]) then
            return "cannot add " .. PREFIX .. p[1]
        end
        parameter[p[1]] = Parameter(PREFIX .. p[1])
    end
    go.used = parameter.GO:get()
    parameter.VER:set(tonumber(VERSION))
    if parameter.LAPSE:get() > 0 then
        laptop.enter(math.min(parameter.LAPSE:get(), 3.0), true)
        if not arming:is_armed() then
            laptop.leave()
        end
    end
    return nil
end

local trouble = missing_call()
if trouble then
    say(CRITICAL, "no %s", trouble)
    return
end
trouble = add_parameters()
if trouble then
    say(CRITICAL, "refused: %s", trouble)
    return
end
say(INFO, "applet %s ready", VERSION)
return update, PERIOD_MS
