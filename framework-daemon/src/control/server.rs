//! The thread: `poll -> come -> read -> one turn each -> go`. An ordinary thread with bounded work in each round, so that no
//! client can keep another from its turn.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded, unbounded};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use super::answer::Sight;
use super::directory::Board;
use super::interface::Refusal;
use super::session::{Session, Wish};
use super::socket::{self, Socket};
use super::{Answered, ReloadOrder};
use crate::fault::manager::Outlook;
use crate::fault::order::{Obeyed, Order};
use crate::model::limits::CONTROL_CLIENTS;

/// Clients that are let in in one round.
const NEWCOMERS: usize = 8;

/// How long nobody is let in when the process has no descriptor left.
const DEAF: Duration = Duration::from_millis(200);

/// Ends the thread, or has it look around.
pub(super) struct Stop {
    asked: AtomicBool,
    bell: UnixStream,
}

impl Stop {
    /// Ends it.
    pub(super) fn stop(&self) {
        self.asked.store(true, Ordering::Release);
        self.wake();
    }

    /// Has it look around. A full pipe wakes it as well.
    pub(super) fn wake(&self) {
        let _ = (&self.bell).write(&[1]);
    }
}

/// All that the thread has.
pub(super) struct Server {
    socket: Socket,
    sight: Sight,
    /// By number, in the order in which they came.
    sessions: BTreeMap<u64, Session>,
    next: u64,
    orders: Sender<ReloadOrder>,
    answers: Receiver<(u64, Answered)>,
    answerer: Sender<(u64, Answered)>,
    ear: UnixStream,
    stop: Arc<Stop>,
    deaf_until: Option<Instant>,
}

impl Server {
    /// A server, and where its orders arrive.
    ///
    /// # Errors
    /// When the system has no descriptor left.
    pub(super) fn new(
        socket: Socket,
        profiles: PathBuf,
        outlook: Outlook,
        board: Arc<Board>,
    ) -> io::Result<(Self, Receiver<ReloadOrder>)> {
        let (ear, bell) = UnixStream::pair()?;
        ear.set_nonblocking(true)?;
        bell.set_nonblocking(true)?;
        let stop = Arc::new(Stop { asked: AtomicBool::new(false), bell });
        let waker = Arc::clone(&stop);
        outlook.feed().on_line(Box::new(move || waker.wake()));
        // Each client has one call on its way at most; one that leaves may leave an order behind.
        let (orders, inbox) = bounded(CONTROL_CLIENTS);
        let (answerer, answers) = unbounded();
        let sight = Sight { board, outlook, profiles };
        let (sessions, next, deaf_until) = (BTreeMap::new(), 0, None);
        Ok((Self { socket, sight, sessions, next, orders, answers, answerer, ear, stop, deaf_until }, inbox))
    }

    pub(super) fn stop(&self) -> Arc<Stop> {
        Arc::clone(&self.stop)
    }

    /// Serves until it is told to end.
    pub(super) fn run(mut self) {
        while !self.stop.asked.load(Ordering::Acquire) {
            self.wait();
            let now = Instant::now();
            while let Ok((number, answer)) = self.answers.try_recv() {
                if let Some(session) = self.sessions.get_mut(&number) {
                    session.answered(answer);
                }
            }
            self.turns(now);
            self.let_in(now);
        }
    }

    /// Waits until somebody wants something.
    fn wait(&mut self) {
        let now = Instant::now();
        let timeout = self.timeout(now);
        let listens = self.deaf_until.is_none_or(|until| now >= until) && self.has_place(now);
        let mut fds = vec![PollFd::new(self.ear.as_fd(), PollFlags::POLLIN)];
        fds.extend(self.sessions.values().map(|session| PollFd::new(session.fd(), session.events())));
        if listens {
            fds.push(PollFd::new(self.socket.listener.as_fd(), PollFlags::POLLIN));
        }
        let found = poll(&mut fds, timeout).unwrap_or_default();
        let events: Vec<_> = fds.iter().map(|fd| fd.revents().unwrap_or(PollFlags::empty())).collect();
        if found > 0 {
            let now = Instant::now();
            for (session, events) in self.sessions.values_mut().zip(events.iter().skip(1)) {
                session.note(*events, now);
            }
            let mut rung = [0; 64];
            while self.ear.read(&mut rung).is_ok_and(|count| count == rung.len()) {}
            // A plugin that closes descriptors of the daemon must not make this thread spin.
            if events.first().is_some_and(|events| !PollFlags::POLLIN.contains(*events)) {
                std::thread::sleep(DEAF);
            }
        }
    }

    /// How long nothing happens by itself.
    fn timeout(&self, now: Instant) -> PollTimeout {
        let sessions = || self.sessions.values();
        let work = sessions().any(Session::has_call);
        // Each of them asks to be woken, so all are asked.
        let lines = sessions().filter(|session| session.awaits_line(&self.sight)).count();
        if work || lines > 0 {
            return PollTimeout::ZERO;
        }
        // While nobody is let in, the next place is waited for.
        let places = sessions().filter_map(Session::expendable).filter(|since| !self.has_place(now) && *since > now);
        let due = sessions().filter_map(Session::due).chain(places).chain(self.deaf_until).min();
        let Some(due) = due else { return PollTimeout::NONE };
        // Rounded up: a look too early would be a look in vain.
        let wait = due.saturating_duration_since(now).as_millis().saturating_add(1);
        PollTimeout::try_from(wait).unwrap_or(PollTimeout::MAX)
    }

    fn turns(&mut self, now: Instant) {
        for (number, session) in &mut self.sessions {
            let (session_number, answers, stop) = (*number, self.answerer.clone(), Arc::clone(&self.stop));
            match session.turn(&self.sight, now) {
                Wish::None => {}
                Wish::Order(verb, slot) => {
                    let answer = Box::new(move |obeyed: Obeyed| {
                        // Who is gone is not waited for.
                        let _ = answers.send((session_number, obeyed.map_err(Refusal::of_order)));
                        stop.wake();
                    });
                    self.sight.outlook.order(Order { verb, slot, answer });
                }
                Wish::Reload => {
                    if self.orders.try_send(ReloadOrder { session: session_number, answers, stop }).is_err() {
                        let busy = vec!["too many reloads wait already: ask again later".to_owned()];
                        session.answered(Err(Refusal::ReloadRefused(busy)));
                        session.flush(now);
                    }
                }
            }
        }
        self.sessions.retain(|_, session| !session.is_over());
    }

    /// True while a newcomer gets a place, or a word of refusal; false while it is worth waiting for one.
    fn has_place(&self, now: Instant) -> bool {
        let mut expendable = self.sessions.values().map(Session::expendable);
        self.sessions.len() < CONTROL_CLIENTS
            || expendable.clone().flatten().any(|since| now >= since)
            || expendable.all(|since| since.is_none())
    }

    fn let_in(&mut self, now: Instant) {
        if self.deaf_until.is_some_and(|until| now < until) {
            return;
        }
        self.deaf_until = None;
        for _ in 0..NEWCOMERS {
            if !self.has_place(now) {
                return;
            }
            match self.socket.listener.accept() {
                Ok((stream, _)) => self.admit(stream, now),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return,
                Err(error) if matches!(error.kind(), io::ErrorKind::Interrupted | io::ErrorKind::ConnectionAborted) => {
                }
                Err(error) => {
                    tracing::warn!("control socket {}: {error}", self.socket.path().display());
                    self.deaf_until = Some(now + DEAF);
                    return;
                }
            }
        }
    }

    fn admit(&mut self, stream: UnixStream, now: Instant) {
        let permitted = socket::check_peer(&stream).map_err(Refusal::NotPermitted);
        let placed = permitted.and_then(|()| self.make_room(now));
        if stream.set_nonblocking(true).is_err() {
            return;
        }
        let mut session = Session::new(stream, now);
        match placed {
            Ok(()) => {
                self.sessions.insert(self.next, session);
                self.next += 1;
            }
            // A fresh socket has room for a word.
            Err(refusal) => {
                session.refuse(refusal);
                session.flush(now);
            }
        }
    }

    /// Who has been idle longest, or does not read what it asked for, leaves when all places are taken.
    fn make_room(&mut self, now: Instant) -> Result<(), Refusal> {
        if self.sessions.len() < CONTROL_CLIENTS {
            return Ok(());
        }
        let expendable = self.sessions.iter().filter_map(|(number, session)| Some((session.expendable()?, *number)));
        match expendable.filter(|(since, _)| now >= *since).min() {
            Some((_, number)) => {
                self.sessions.remove(&number);
                Ok(())
            }
            None => Err(Refusal::TooManyClients(format!(
                "{CONTROL_CLIENTS} clients are there already, and all follow something: end one of them"
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::Shutdown;
    use std::sync::Mutex;

    use proptest::prelude::*;
    use serde_json::Map;

    use super::super::Control;
    use super::super::client::{CallError, Client};
    use super::*;
    use crate::fault::journal::Journal;
    use crate::fault::manager;

    /// What a client may do.
    #[derive(Clone, Debug)]
    enum Step {
        Bytes(Vec<u8>),
        Call(&'static str, bool),
        EndInput,
        Leave,
    }

    fn step() -> impl Strategy<Value = Step> {
        let methods = ["Status", "ListPorts", "ListFaults", "Follow", "Hz", "Reload", "DescribePort", "Nothing"];
        prop_oneof![
            3 => prop::collection::vec(prop_oneof![1 => Just(0u8), 9 => any::<u8>()], 0..300).prop_map(Step::Bytes),
            5 => (prop::sample::select(methods.to_vec()), any::<bool>()).prop_map(|(name, more)| Step::Call(name, more)),
            1 => Just(Step::EndInput),
            1 => Just(Step::Leave),
        ]
    }

    struct Served {
        control: Control,
        _faults: crate::model::fault::FaultSender,
        scratch: tempfile::TempDir,
    }

    fn serve() -> Served {
        let scratch = tempfile::tempdir().unwrap();
        let journal = Journal::open(&scratch.path().join("journal.jsonl")).unwrap();
        let (manager, faults) = manager::start(Arc::new(Mutex::new(journal))).unwrap();
        let socket = Socket::take(&scratch.path().join("s")).unwrap();
        let control = Control::start(socket, scratch.path().to_owned(), manager.outlook()).unwrap();
        Served { control, _faults: faults, scratch }
    }

    impl Served {
        fn connect(&self) -> Client {
            Client::connect(Some(&self.scratch.path().join("s"))).unwrap()
        }
    }

    fn play(steps: &[Step], path: &std::path::Path) -> Option<UnixStream> {
        let mut stream = UnixStream::connect(path).unwrap();
        stream.set_nonblocking(true).unwrap();
        for step in steps {
            // Who is hung up on, or does not read, cannot write either.
            let _ = match step {
                Step::Bytes(bytes) => stream.write(bytes).map(drop),
                Step::Call(method, more) => {
                    let call = serde_json::json!({"method": format!("io.frameworkdaemon.{method}"), "more": more});
                    stream.write(format!("{call}\0").as_bytes()).map(drop)
                }
                Step::EndInput => stream.shutdown(Shutdown::Write),
                Step::Leave => return None,
            };
        }
        Some(stream)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        /// Whatever others did, do not read or leave half said: who asks is answered.
        #[test]
        fn nobody_holds_anybody_up(clients in prop::collection::vec(prop::collection::vec(step(), 0..12), 0..30)) {
            let served = serve();
            let path = served.scratch.path().join("s");
            let staying: Vec<_> = clients.iter().filter_map(|steps| play(steps, &path)).collect();
            let status = served.connect().call("Status", Map::new());
            prop_assert!(matches!(&status, Ok(status) if status["state"] == "starting"), "{status:?}");
            drop(staying);
        }
    }

    #[test]
    fn a_reload_is_passed_on_and_its_answer_back() {
        let served = serve();
        let orders = served.control.orders().clone();
        let answering = std::thread::spawn(move || {
            let changes = super::super::Changes { kept: 3, ..Default::default() };
            orders.recv().unwrap().answer(&Ok(changes));
            orders.recv().unwrap().answer(&Err(vec!["no".to_owned()]));
        });
        let mut client = served.connect();
        assert_eq!(client.call_patiently("Reload", Map::new()).unwrap()["kept"], 3);
        let Err(CallError::Refused { name, parameters }) = client.call_patiently("Reload", Map::new()) else {
            panic!("it was refused")
        };
        assert_eq!((name.as_str(), &parameters["reasons"][0]), ("io.frameworkdaemon.ReloadRefused", &"no".into()));
        answering.join().unwrap();
    }

    #[test]
    fn who_waits_when_the_daemon_ends_is_hung_up_on() {
        let served = serve();
        let mut client = served.connect();
        let waiting = std::thread::spawn(move || client.call_patiently("Reload", Map::new()));
        let order = served.control.orders().recv().unwrap();
        let Served { control, scratch, .. } = served;
        drop(control);
        assert!(matches!(waiting.join().unwrap(), Err(CallError::Unreachable(told)) if told.contains("it hung up")));
        assert!(!scratch.path().join("s").exists());
        order.answer(&Err(Vec::new()));
    }
}
