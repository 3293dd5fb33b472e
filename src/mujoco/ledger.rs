//! Accounts of how far bodies have moved, against the clearances between them.

use super::placement::Placement;
use super::proximity::{Proximity, WORLD};
use super::simulation::Simulation;

/// The ways of all parts of a [`Proximity`], and what they leave of the clearance of each group.
///
/// A group has a slack: a lower bound of the distance that is left before it may have a contact. It shrinks by no more
/// than the ways of both parts. When it is used up, the group is looked at again. Ways are measured in the world, or for
/// the parts of a hand in the hand's frame, which has a way of its own: that of the sphere around the hand. Only groups
/// with one part in the hand pay for that.
#[derive(Debug, Clone)]
pub(super) struct Ledger {
    hand: Option<Hand>,
    /// By part. The first, the world, stays as it is.
    members: Vec<Member>,
    /// Those near come first, to be watched one by one.
    accounts: Vec<Account>,
    near: usize,
    /// The least that the other accounts have, of groups within the hand and of all others, m.
    far_within: f64,
    far_others: f64,
    /// No account holds: it is the first call, or a pose was not a number.
    stale: bool,
}

/// The frame of a hand.
#[derive(Debug, Clone)]
struct Hand {
    body: usize,
    was: Placement,
    /// Of the sphere about the body's centre that held all parts when all groups were counted, m.
    radius: f64,
    /// Of that sphere, in the world, m.
    way: f64,
    /// The two longest ways within the hand.
    longest: Longest,
}

#[derive(Debug, Clone)]
struct Member {
    body: usize,
    in_hand: bool,
    /// m.
    radius: f64,
    was: Placement,
    /// In the frame of the hand or the world, since the last count of all groups, m.
    way: f64,
}

#[derive(Debug, Clone, Copy)]
struct Account {
    group: u32,
    parts: [u32; 2],
    /// One part is in the hand.
    crosses: bool,
    /// No contact until the ways of both parts (and the hand's) add up to this, m.
    until: f64,
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

impl Ledger {
    /// For all groups. `hand` is the body whose frame the parts in the hand are seen from, and says of each body
    /// whether it is in the hand.
    pub fn new(proximity: &Proximity, hand: Option<(usize, Vec<bool>)>) -> Self {
        let member = |(part, of): (usize, &super::proximity::Part)| Member {
            body: of.body,
            in_hand: part != WORLD && hand.as_ref().is_some_and(|(_, held)| held[of.body]),
            radius: of.radius,
            was: Placement::default(),
            way: 0.0,
        };
        let members: Vec<Member> = proximity.parts.iter().enumerate().map(member).collect();
        let account = |(group, parts): (usize, [usize; 2])| {
            let [a, b] = parts.map(|part| members[part].in_hand);
            Account {
                group: group as u32,
                parts: parts.map(|part| part as u32),
                crosses: a != b,
                until: f64::NEG_INFINITY,
            }
        };
        let groups = proximity.groups.iter().map(|group| group.parts);
        Self {
            accounts: groups.enumerate().map(account).collect(),
            hand: hand.map(|(body, _)| Hand {
                body,
                was: Placement::default(),
                radius: 0.0,
                way: 0.0,
                longest: Longest::default(),
            }),
            members,
            near: 0,
            far_within: 0.0,
            far_others: 0.0,
            stale: true,
        }
    }

    /// Adds what has moved since the last call. The first group that may have a contact now; an error if a pose is not
    /// a number.
    pub fn first_blocked(
        &mut self,
        sim: &Simulation,
        proximity: &mut Proximity,
    ) -> Result<Option<usize>, NotANumber> {
        let Some(longest) = self.advance(sim) else {
            self.clear_ways(sim);
            self.stale = true;
            return Err(NotANumber);
        };
        let (within, carried) = match &self.hand {
            Some(hand) => (hand.longest.sum(), hand.way),
            None => (0.0, 0.0),
        };
        let used_up = within >= self.far_within || longest + carried >= self.far_others;
        if self.stale || used_up {
            self.count_all(sim, proximity);
        }
        for i in 0..self.near {
            let account = self.accounts[i];
            let used = self.used(&account);
            if used >= account.until {
                let slack = proximity.look(sim, account.group as usize);
                self.accounts[i].until = used + slack;
                if !(slack > 0.0) {
                    return Ok(Some(account.group as usize));
                }
            }
        }
        Ok(None)
    }

    /// Adds to all ways; the sum of the two longest, or `None` if one is not a number.
    fn advance(&mut self, sim: &Simulation) -> Option<f64> {
        let mut sound = true;
        let mut longest = Longest::default();
        let motion = self.hand.as_mut().map(|hand| {
            let now = Placement::of(sim, hand.body);
            let motion = now.since(&hand.was);
            // Points may have left the sphere by as much as they have moved within the hand.
            hand.way += now.moved(&hand.was, hand.radius + hand.longest.0);
            sound &= hand.way.is_finite();
            hand.was = now;
            motion
        });
        let mut within = Longest::default();
        for member in &mut self.members[WORLD + 1..] {
            let now = Placement::of(sim, member.body);
            match &motion {
                Some(motion) if member.in_hand => {
                    let carried = motion.carry(&member.was);
                    member.way += now.moved(&carried, member.radius);
                    within.add(member.way);
                }
                _ => member.way += now.moved(&member.was, member.radius),
            }
            member.was = now;
            sound &= member.way.is_finite();
            longest.add(member.way);
        }
        if let Some(hand) = &mut self.hand {
            hand.longest = within;
        }
        sound.then(|| longest.sum())
    }

    #[inline]
    fn used(&self, account: &Account) -> f64 {
        let [a, b] = account.parts.map(|part| self.members[part as usize].way);
        match &self.hand {
            Some(hand) if account.crosses => a + b + hand.way,
            _ => a + b,
        }
    }

    /// Finds out which groups are near, and how far the others can move; all ways start again from zero.
    fn count_all(&mut self, sim: &Simulation, proximity: &mut Proximity) {
        self.near = 0;
        (self.far_within, self.far_others) = (f64::INFINITY, f64::INFINITY);
        for i in 0..self.accounts.len() {
            let mut account = self.accounts[i];
            account.until -= self.used(&account);
            if self.stale || account.until <= 0.0 {
                account.until = proximity.look(sim, account.group as usize);
            }
            self.accounts[i] = account;
            if account.until >= proximity.reach {
                let [a, b] = account
                    .parts
                    .map(|part| self.members[part as usize].in_hand);
                let far = if a && b {
                    &mut self.far_within
                } else {
                    &mut self.far_others
                };
                *far = far.min(account.until);
            } else {
                self.accounts.swap(i, self.near);
                self.near += 1;
            }
        }
        self.clear_ways(sim);
        self.stale = false;
    }

    fn clear_ways(&mut self, sim: &Simulation) {
        self.members.iter_mut().for_each(|member| member.way = 0.0);
        if let Some(hand) = &mut self.hand {
            let held = self.members.iter().filter(|member| member.in_hand);
            hand.radius = held
                .map(|member| Placement::of(sim, member.body).distance(&hand.was) + member.radius)
                .fold(0.0, f64::max);
            (hand.way, hand.longest) = (0.0, Longest::default());
        }
    }
}

/// A pose is not a number, so nothing is known.
#[derive(Debug)]
pub(super) struct NotANumber;
