#!/usr/bin/env escript
%% Erlang/OTP's supervisor: an error exit, then the new process answers its first call. Prints nanoseconds, one a line.
%% Usage: escript restart.escript COUNT
-mode(compile).
-behaviour(supervisor).
-export([init/1, start_worker/1, worker/1]).

main([Count]) ->
    %% Reports of crashes would be most of the time.
    logger:set_primary_config(level, none),
    process_flag(trap_exit, true),
    {ok, _} = supervisor:start_link(?MODULE, self()),
    First = receive {ready, Pid} -> Pid end,
    rounds(list_to_integer(Count), First).

init(Bench) ->
    Child = #{id => worker, start => {?MODULE, start_worker, [Bench]}, restart => permanent},
    {ok, {#{strategy => one_for_one, intensity => 1000000, period => 1}, [Child]}}.

start_worker(Bench) ->
    proc_lib:start_link(?MODULE, worker, [Bench]).

worker(Bench) ->
    proc_lib:init_ack({ok, self()}),
    Bench ! {ready, self()},
    serve().

serve() ->
    receive
        {call, From} ->
            From ! {answer, self()},
            serve();
        {fail, From} ->
            From ! {failed, erlang:monotonic_time(nanosecond)},
            error(torture)
    end.

rounds(0, _) -> ok;
rounds(Count, Pid) ->
    %% As ours: the caches may cool down, the scheduler may run others.
    timer:sleep(1),
    Pid ! {fail, self()},
    At = receive {failed, Time} -> Time end,
    Next = receive {ready, New} -> New end,
    Next ! {call, self()},
    receive {answer, Next} -> ok end,
    io:format("~b~n", [erlang:monotonic_time(nanosecond) - At]),
    rounds(Count - 1, Next).
