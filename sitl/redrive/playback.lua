-- Plays a recorded drive on a simulated rover: steering PWM as it was, speed followed. Not for a real one.
--
-- In front of this text stand the locals DT, STEERING, STATES, RUNS, SPEED_DT, SPEEDS, FEEDFORWARD, US_PER_SPEED.
-- STEERING: four digits (us) for each DT seconds; STATES: the applet's state, one letter from 'A' for 0, or "";
-- RUNS: {first cell, last cell, run, clock of the override less time}; SPEEDS (mm/s) and FEEDFORWARD (us, the
-- throttle that holds the speed) four digits for each SPEED_DT; US_PER_SPEED: throttle for a speed, us s/m.

local LATENCY_MS, PERIOD_MS = 200, 10
local FOLLOW, INTEGRAL = 5.0, 2.0 -- gains of the speed: 1/s of the motor's lag, and of the integral
local STANDING = 0.15 -- m/s, below which the recorded rover stood
local BEFORE_S = 1.0 -- from arming to the beginning, so that the log is open
local steer_channel, throttle_channel = SRV_Channels:find_channel(26), SRV_Channels:find_channel(70)
local armed_at, integral, last, told, done = nil, 0.0, 0.0, false, false

local function digits(text, k)
    return tonumber(string.sub(text, 4 * k + 1, 4 * k + 4))
end

local function throttle(t, vn, ve)
    local k = math.floor(t / SPEED_DT)
    local wanted = (digits(SPEEDS, k) or 0) * 0.001
    if wanted < STANDING then
        integral = 0.0
        return digits(FEEDFORWARD, k) or 1500
    end
    local off = wanted - math.sqrt(vn * vn + ve * ve)
    integral = math.min(math.max(integral + off * (t - last) * INTEGRAL, -0.5), 0.5)
    return digits(FEEDFORWARD, k) + (FOLLOW * off * 0.7 + integral) * US_PER_SPEED
end

local function note(t, cell, pwm, vn, ve)
    if STATES == "" then
        logger:write("SWEP", "Cmd,Out,VN,VE", "ffff", "YYnn", "0000", pwm, pwm, vn, ve)
        return
    end
    local run, clock = 0, 0.0
    for _, r in ipairs(RUNS) do
        if cell >= r[1] and cell <= r[2] then run, clock = r[3], t + r[4] end
    end
    if run == 0 then return end
    local state = string.byte(STATES, cell + 1) - 65
    logger:write("SWEP", "Run,St,T,Cmd,Out,VN,VE", "HBfffff", "--sYYnn", "--00000", run, state, clock, pwm, pwm, vn, ve)
end

local function update()
    if done then return update, 200 end
    if not arming:is_armed() then
        armed_at = nil
        return update, 50
    end
    armed_at = armed_at or micros()
    local t = (micros() - armed_at):tofloat() * 1e-6 - BEFORE_S
    if t < 0 then return update, PERIOD_MS end
    if not told then
        told = true
        gcs:send_text(6, "REDRIVE: begins")
    end
    local cell = math.floor(t / DT)
    local pwm = digits(STEERING, cell)
    if not pwm then
        done = true
        gcs:send_text(6, "REDRIVE: done")
        return update, 200
    end
    local velocity = ahrs:get_velocity_NED()
    local vn, ve = 0.0, 0.0
    if velocity then vn, ve = velocity:x(), velocity:y() end
    SRV_Channels:set_output_pwm_chan_timeout(steer_channel, pwm, LATENCY_MS)
    local drive = math.floor(math.min(math.max(throttle(t, vn, ve), 1000), 2000) + 0.5)
    SRV_Channels:set_output_pwm_chan_timeout(throttle_channel, drive, LATENCY_MS)
    logger:write("RDRV", "T,Thr", "ff", "sY", "00", t, drive)
    note(t, cell, pwm, vn, ve)
    last = t
    return update, PERIOD_MS
end

return update, 1000
