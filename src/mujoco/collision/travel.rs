//! Accounts of how far bodies have moved, against the clearances between them.

// A distance that is not a number must count as too near: `!(a > b)` says that, `a <= b` does not.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::distances::{Proximity, WORLD};
use super::motion::Placement;
use crate::mujoco::simulation::Simulation;

/// The ways of all parts of a [`Proximity`], and what they leave of the clearance of each group.
///
/// A group has a slack: a lower bound of the distance that is left before it may have a contact. It shrinks by no more
/// than the ways of both parts. When it is used up, the group is looked at again. Ways are measured in the world, or for
/// the parts of a hand in the hand's frame, which has a way of its own: that of the sphere around the hand. Only groups
/// with one part in the hand pay for that.
#[derive(Debug, Clone)]
pub(super) struct Ledger {
    hand: Option<Hand>,
    outside: Vec<Member>,
    /// By part: how far it has come in its frame, m. That of the world stays zero.
    ways: Vec<f64>,
    /// Sums of what the two fastest parts of each call moved, outside of the hand; and of the fastest outside and the
    /// fastest inside, m.
    travel_outside: f64,
    travel_across: f64,
    accounts_outside: Accounts,
    accounts_across: Accounts,
    accounts_inside: Accounts,
    /// Groups are looked at again once less than this is left of their slack, m.
    wanted: f64,
    /// Nothing is known: it is the first call, or a pose was not a number.
    stale: bool,
}

/// The frame of a hand.
#[derive(Debug, Clone)]
struct Hand {
    body: usize,
    was: Placement,
    members: Vec<Member>,
    /// Of a sphere about the body's centre that held all parts at `radius_at`, m.
    radius: f64,
    radius_at: f64,
    /// Of that sphere in the world, m.
    way: f64,
    /// Sum of what the two fastest parts of each call moved inside, m.
    travel: f64,
}

/// A part that moves.
#[derive(Debug, Clone)]
struct Member {
    part: usize,
    body: usize,
    /// m.
    radius: f64,
    was: Placement,
}

/// Groups whose slack is used up by the same kind of motion.
#[derive(Debug, Clone, Default)]
struct Accounts {
    /// Those near come first, to be watched one by one.
    all: Vec<Account>,
    near: usize,
    /// The travel up to which the others have slack, m.
    far_until: f64,
}

#[derive(Debug, Clone, Copy)]
struct Account {
    parts: [u32; 2],
    group: u32,
    /// No contact until the ways of both parts (and the hand's) add up to this, m.
    until: f64,
}

/// A pose is not a number, so nothing is known.
#[derive(Debug)]
pub(super) struct NotANumber;

impl Ledger {
    /// For all groups. `hand` is the body whose frame the parts in the hand are seen from, and says of each body
    /// whether it is in the hand.
    pub fn new(proximity: &Proximity, hand: Option<(usize, Vec<bool>)>) -> Self {
        let held = |part: usize| {
            let body = proximity.parts[part].body;
            part != WORLD && hand.as_ref().is_some_and(|(_, held)| held[body])
        };
        let member = |part: usize| Member {
            part,
            body: proximity.parts[part].body,
            radius: proximity.parts[part].radius,
            was: Placement::default(),
        };
        let (inside, outside): (Vec<usize>, Vec<usize>) =
            (WORLD + 1..proximity.parts.len()).partition(|&part| held(part));
        let accounts = |parts_held: usize| {
            let groups = proximity.groups.iter().enumerate();
            let counted =
                groups.filter(|(_, group)| group.parts.iter().filter(|&&part| held(part)).count() == parts_held);
            let account = |(group, of): (usize, &super::distances::Group)| Account {
                parts: of.parts.map(|part| part as u32),
                group: group as u32,
                until: f64::NEG_INFINITY,
            };
            Accounts { all: counted.map(account).collect(), ..Accounts::default() }
        };
        Self {
            accounts_outside: accounts(0),
            accounts_across: accounts(1),
            accounts_inside: accounts(2),
            outside: outside.into_iter().map(member).collect(),
            ways: vec![0.0; proximity.parts.len()],
            travel_outside: 0.0,
            travel_across: 0.0,
            hand: hand.as_ref().map(|(body, _)| Hand {
                body: *body,
                was: Placement::default(),
                members: inside.into_iter().map(member).collect(),
                radius: 0.0,
                radius_at: 0.0,
                way: 0.0,
                travel: 0.0,
            }),
            wanted: 0.0,
            stale: true,
        }
    }

    /// For [`outlasts`](Self::outlasts): so much of every group's slack is to be left, as far as it is so \[m\].
    pub fn want(&mut self, wanted: f64) {
        self.wanted = wanted;
    }

    /// Adds what has moved since the last call. The first group that may have a contact now; an error if a pose is not
    /// a number.
    pub fn first_blocked(&mut self, sim: &Simulation, proximity: &mut Proximity) -> Result<Option<usize>, NotANumber> {
        if !self.advance(sim) {
            self.forget();
            return Err(NotANumber);
        }
        let (inside, carried) = match &self.hand {
            Some(hand) => (hand.travel, hand.way),
            None => (0.0, 0.0),
        };
        let across = self.travel_across + carried;
        let kinds = [
            (&mut self.accounts_outside, self.travel_outside, 0.0),
            (&mut self.accounts_across, across, carried),
            (&mut self.accounts_inside, inside, 0.0),
        ];
        let mut counted = false;
        for (accounts, travel, carried) in kinds {
            if self.stale || travel + self.wanted >= accounts.far_until {
                accounts.count(sim, proximity, &self.ways, (carried, self.wanted), travel, self.stale);
                counted = true;
            }
        }
        self.stale = false;
        if let (true, Some(hand)) = (counted, &mut self.hand) {
            hand.measure(sim);
        }
        let (ways, wanted) = (&self.ways, self.wanted);
        let blocked = self.accounts_outside.first_blocked(sim, proximity, ways, (0.0, wanted));
        let blocked = blocked.or_else(|| self.accounts_across.first_blocked(sim, proximity, ways, (carried, wanted)));
        Ok(blocked.or_else(|| self.accounts_inside.first_blocked(sim, proximity, ways, (0.0, wanted))))
    }

    /// Whether no group can have a contact after any part has come by `way`, and two parts nearer to each other by
    /// `approach` of them \[m\].
    pub fn outlasts(&self, way: f64, approach: impl Fn([usize; 2]) -> f64) -> bool {
        let (inside, carried) = self.hand.as_ref().map_or((0.0, 0.0), |hand| (hand.travel, hand.way));
        let kinds = [
            (&self.accounts_outside, self.travel_outside, 0.0),
            (&self.accounts_across, self.travel_across + carried, carried),
            (&self.accounts_inside, inside, 0.0),
        ];
        kinds.into_iter().all(|(accounts, travel, carried)| {
            let mut near = accounts.all[..accounts.near].iter();
            let left = |account: &Account| account.until - account.used(&self.ways) - carried;
            let outlasts = |account: &Account| {
                2.0 * way <= left(account) || approach(account.parts.map(|part| part as usize)) <= left(account)
            };
            2.0 * way <= accounts.far_until - travel && near.all(outlasts)
        })
    }

    /// Adds to all ways and travels; false if one is not a number.
    fn advance(&mut self, sim: &Simulation) -> bool {
        let outside = advance(sim, &mut self.outside, &mut self.ways, |was| *was);
        self.travel_outside += outside.sum();
        self.travel_across += outside.0;
        let mut carried = 0.0;
        if let Some(hand) = &mut self.hand {
            let now = Placement::of(sim, hand.body);
            let motion = now.since(&hand.was);
            // Points may have left the sphere by as much as they have travelled inside.
            let radius = hand.radius + (hand.travel - hand.radius_at);
            hand.way += now.moved(&hand.was, radius);
            hand.was = now;
            let inside = advance(sim, &mut hand.members, &mut self.ways, |was| motion.carry(was));
            hand.travel += inside.sum();
            self.travel_across += inside.0;
            carried = hand.way;
        }
        // The largest does not see what is not a number; the sums do.
        (self.ways.iter().sum::<f64>() + carried).is_finite()
    }

    fn forget(&mut self) {
        self.ways.fill(0.0);
        (self.travel_outside, self.travel_across) = (0.0, 0.0);
        if let Some(hand) = &mut self.hand {
            (hand.way, hand.travel, hand.radius_at) = (0.0, 0.0, 0.0);
        }
        self.stale = true;
    }
}

/// Adds to the ways of some parts, of which `carried` says where they would be had they not moved; the two longest
/// moves.
#[inline]
fn advance(
    sim: &Simulation,
    members: &mut [Member],
    ways: &mut [f64],
    carried: impl Fn(&Placement) -> Placement,
) -> Longest {
    let mut longest = Longest::default();
    for member in members {
        let now = Placement::of(sim, member.body);
        let moved = now.moved(&carried(&member.was), member.radius);
        member.was = now;
        ways[member.part] += moved;
        longest.add(moved);
    }
    longest
}

/// The two largest numbers.
#[derive(Debug, Clone, Copy, Default)]
struct Longest(f64, f64);

impl Longest {
    #[inline]
    fn add(&mut self, way: f64) {
        self.1 = self.1.max(way.min(self.0));
        self.0 = self.0.max(way);
    }

    fn sum(&self) -> f64 {
        self.0 + self.1
    }
}

impl Hand {
    /// Draws the sphere anew.
    fn measure(&mut self, sim: &Simulation) {
        let reach = |member: &Member| Placement::of(sim, member.body).distance(&self.was) + member.radius;
        self.radius = self.members.iter().map(reach).fold(0.0, f64::max);
        self.radius_at = self.travel;
    }
}

impl Accounts {
    /// Finds out which groups are near, and up to which travel the others have slack.
    fn count(
        &mut self,
        sim: &Simulation,
        proximity: &mut Proximity,
        ways: &[f64],
        (carried, wanted): (f64, f64),
        travel: f64,
        stale: bool,
    ) {
        self.near = 0;
        let mut least = f64::INFINITY;
        for i in 0..self.all.len() {
            let account = &mut self.all[i];
            let used = account.used(ways) + carried;
            let mut slack = account.until - used;
            if stale || slack <= wanted {
                slack = proximity.look(sim, account.group as usize);
                account.until = used + slack;
            }
            if slack >= proximity.reach {
                least = least.min(slack);
            } else {
                self.all.swap(i, self.near);
                self.near += 1;
            }
        }
        self.far_until = travel + least;
    }

    /// The first near group that may have a contact.
    #[inline]
    fn first_blocked(
        &mut self,
        sim: &Simulation,
        proximity: &mut Proximity,
        ways: &[f64],
        (carried, wanted): (f64, f64),
    ) -> Option<usize> {
        for account in &mut self.all[..self.near] {
            let used = account.used(ways) + carried;
            if used + wanted >= account.until {
                let slack = proximity.look(sim, account.group as usize);
                account.until = used + slack;
                if !(slack > 0.0) {
                    return Some(account.group as usize);
                }
            }
        }
        None
    }
}

impl Account {
    #[inline]
    fn used(&self, ways: &[f64]) -> f64 {
        let [a, b] = self.parts;
        ways[a as usize] + ways[b as usize]
    }
}
