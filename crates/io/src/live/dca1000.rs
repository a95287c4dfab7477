//! A DCA1000 capture card on the network.
