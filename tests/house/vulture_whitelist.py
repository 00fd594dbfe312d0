"""Names that vulture reports although other programs or getattr use them. Only vulture reads this file."""

from typing import Any

it: Any = None

_ = [
    it.baudrate,  # pyserial sets the speed of an open port
    # called by click, IPython, textual and textual-serve
    it.list_commands,
    it.get_command,
    it.format_commands,
    it.format_options,
    it._repr_html_,
    it._open_app_process,
    it._stdin,
    it.handle_websocket,
    it.initialize_logging,
    it.theme,
    # the public results, for users' Python; the functions are found by address (rover_sweep.data.recording)
    it.plot,
    it.plot_curves,
    it.to_frame,
    it.interval_90,
    it.responses,
    it.draw_run,
    it.draw_one_response,
    it.draw_model,
    it.draw_verification,
    # called from Lua (sitl/autopilot/lua_api.lua)
    it.override_rc,
    it.rc_with_option,
    # fields of the vehicle file and of a plan's evidence, read by getattr
    it.asymmetry,
    it.backlash,
    it.nonlinearity,
    it.own_effects,
    it.own_tolerances,
    # read or called by pymavlink
    it.link_id,
    it.sign_outgoing,
    it.allow_unsigned_callback,
    it.robust_parsing,
    it.source_system,
    it.source_component,
    it.mav,
    it.file_transfer_protocol_send,
    it.recv_match,
    it.idle_detection_time,
    # columns of an exported rover's motion, written by their names
    it.V_x,
    it.V_y,
    it.a_y,
    # of a document, read by its template
    it.anchor,
    it.subtitle,
    it.foot,
    # the slave in an FMU, called and read by pythonfmu
    it.RoverTwin,
    it.modelName,
    it.setup_experiment,
    it.do_step,
    # called by the applet in Lua (sitl/autopilot/lua_api.lua)
    it.add_parameter,
    it.get_parameter,
    it.set_parameter,
    it.rc_pwm,
    it.aux_position,
    it.rc_valid,
    it.servo_channel,
    it.override_servo,
    it.servo_pwm,
    it.velocity_ned,
    it.gcs_last_seen_ms,
    it.named_float,
]
